"""Make a recording of your own arrays, and save the model that is fitted to it."""

import numpy as np

import ground

other = ground.simulate("cfg/hovercraft/tiny_whoover.yaml", duration=10).to_frame().dropna()
times = other["t"].to_numpy()  # [s]
poses = other[["x", "y", "psi"]].to_numpy()  # [m], [rad]
commands = np.clip(other[["left", "right", "lift"]].to_numpy(), 0, 1)
run = ground.Recording.from_arrays(times, poses, commands, name="mine")
print(run)
fit = ground.fit("cfg/hovercraft/tiny_whoover.yaml", run, free=["k"])
print(fit.save("mine.yaml").fitted.ci95["k"])
