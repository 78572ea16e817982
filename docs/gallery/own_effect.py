"""Write an effect as a Python function, and let a diagnosis find it."""

import numpy as np

import ground


def waves(state, inputs, a):
    return a * np.sin(2 * np.pi * state.x / 0.3), 0, 0  # X, Y [N], N [N m]


model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
effect = ground.Effect("waves", force=waves, a=(0.01, "N"), frame="world")
run = ground.simulate(model + effect, duration=15, seed=1)
print(ground.diagnose(model, run, only=["wind", "waves"], effects=[effect]).effects)
