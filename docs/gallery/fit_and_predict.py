"""Fit a model to two runs, and see what it predicts of a third."""

import ground

model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
flown = model.with_values({"k": 0.07}) + ground.Effect("wind", wx=0.3)  # what flies
runs = [ground.simulate(flown, duration=10, seed=seed, name="run %d" % seed) for seed in (1, 2, 3)]
fit = ground.fit(model, runs[:2])
print(fit.to_frame()[["value", "low", "high", "unit"]])
prediction = fit.predict(runs[2], horizon=1.0)
print(prediction)
prediction.plot("motion").write_html("prediction.html")
