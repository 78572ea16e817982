"""The fitted model as NumPy code for a controller of your own."""

import runpy

import ground

craft = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml").with_effect("motor_lag", tau=0.05)
fitted = ground.fit(craft, ground.simulate(craft, "prbs", duration=10, seed=1))
print("states:", *fitted.model.export("craft_numpy.py", force=True).states)

code = runpy.run_path("craft_numpy.py")  # in your program: import craft_numpy
now = (0, 0, 0, 0.4, 0, 0, *code["INITIAL"])  # x, y, psi, u, v, r, states of effects
for i in range(100):
    now = code["step"](now, (0.8, 0.6, 1.0), 0.01, 0.01 * i)
print("after 1 s: %.2f m ahead, %.2f m to starboard" % tuple(now[:2]))
