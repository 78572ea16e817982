"""Fit each of several runs by itself, in parallel, and see how the estimates scatter."""

from concurrent.futures import ProcessPoolExecutor
from functools import partial

import pandas

import ground

if __name__ == "__main__":  # on some systems each process reads this file
    model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
    for seed in range(1, 5):
        ground.simulate(model, duration=8, seed=seed).save("flight%d.bag" % seed)
    runs = ground.read("flight*.bag")
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(partial(ground.fit, model, free=["k", "N_r"]), runs))
    table = pandas.DataFrame({run.name: one.to_frame()["value"] for run, one in zip(runs, found)})
    print(table.T.describe().loc[["mean", "std"]])
