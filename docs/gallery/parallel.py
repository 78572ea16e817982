"""Fit each of several runs by itself, in parallel, and see how the estimates scatter."""

import joblib
import pandas

import ground

model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
for seed in range(1, 5):
    ground.simulate(model, duration=8, seed=seed).save("flight%d.bag" % seed)
runs = ground.read("flight*.bag")
fit = joblib.delayed(ground.fit)
found = joblib.Parallel(2)(fit(model, run, free=["k", "N_r"]) for run in runs)
table = pandas.DataFrame({run.name: one.to_frame()["value"] for run, one in zip(runs, found)})
print(table.T.describe().loc[["mean", "std"]])
