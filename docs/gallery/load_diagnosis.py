"""Load a diagnosis that was saved, and let a controller fly by its model."""

import ground

model = "cfg/hovercraft/tiny_whoover.yaml"
flown = ground.Model.load(model) + ground.Effect("yaw_bias", n0=2e-5)
runs = [ground.simulate(flown, duration=10, seed=seed) for seed in (1, 2)]
ground.diagnose(model, runs, only=["yaw_bias", "wind"]).save("diagnosis")

found = ground.load("diagnosis")
print(found.verdict, found.effects, found.to_frame()["selected"].sum())
found.plot("errors").write_html("errors.html")
circle = dict(controller="ModelPredictive", truth=flown, settled=20, end_time=30)
given, improved = (ground.track(one, **circle).rms for one in (model, found.improved))
print("off the circle: %.4f mm, by the improved model %.4f mm" % (1e3 * given, 1e3 * improved))
