"""Load a diagnosis that was saved, and let a controller fly by its model."""

import ground

model = "cfg/hovercraft/tiny_whoover.yaml"
flown = ground.Model.load(model) + ground.Effect("yaw_bias", n0=2e-5)
runs = [ground.simulate(flown, duration=10, seed=seed) for seed in (1, 2)]
ground.diagnose(model, runs, only=["yaw_bias", "wind"]).save("diagnosis")

found = ground.load("diagnosis")
print(found.verdict, found.effects, found.to_frame()["selected"].sum())
found.plot("errors").write_html("errors.html")
gains = "cfg/gains/tiny_whoover.yaml"
tracked = ground.track(found.improved, truth=flown, gains=gains, settled=20, end_time=30)
print("%.0f mm off the circle" % (1e3 * tracked.rms))
