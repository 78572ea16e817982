#!/usr/bin/python3
"""Finds the missing effect with PySINDy: sparse regression of the accelerations.

Argument: a JSON file with nu (samples x 3), psi, inputs (samples x 2) and dt of the runs of each case.
Prints a JSON object for each case: the effect found, and the time it took [s].

PySINDy gets the best settings that we know for this question. It sees the smoothed velocities of our
fit. Its terms are those of the rigid body and of every effect that is a term of an acceleration, scaled
by their deviation. Cross-validation over runs chooses the width of the smoothed finite differences and
the threshold. Terms of the nominal model are always kept. The answer is the effect whose terms have the
largest part in the accelerations.
"""
import json
import sys
import time
import warnings

import numpy as np
import pysindy

# {effect: (equation, term)}; equations are 0: surge, 1: sway, 2: yaw.
EFFECTS = {
    "quadratic_drag": [(0, "V u"), (1, "V v"), (2, "|r| r")],
    "coulomb_friction": [(0, "u/V"), (1, "v/V"), (2, "sign r")],
    "sway_yaw_damping": [(1, "r"), (2, "v")],
    "yaw_bias": [(2, "1")],
    "body_force_bias": [(0, "1"), (1, "1")],
    "floor_tilt": [(0, "cos"), (0, "sin"), (1, "cos"), (1, "sin")],
    "thrust_asymmetry": [(0, "difference"), (2, "sum")],
    "thrust_misalignment": [(1, "sum")],
    "differential_side_force": [(1, "difference")],
    "thrust_sway_moment": [(2, "sum v")],
    "thrust_speed_loss": [(0, "sum u"), (2, "difference u")],
}
NOMINAL = [["r v", "sum", "u"], ["r u", "v"], ["difference", "r"]]
THRESHOLDS = [0.003, 0.01, 0.03, 0.1]  # relative to the acceleration's deviation
WIDTHS = [7, 15, 31]  # samples


def terms(nu, psi, inputs):
    u, v, r = nu.T
    speed = np.hypot(u, v)
    total, difference = inputs.sum(axis=1), inputs[:, 0] - inputs[:, 1]
    return {
        "1": np.ones(len(u)), "u": u, "v": v, "r": r, "r v": r * v, "r u": r * u,
        "V u": speed * u, "V v": speed * v, "|r| r": np.abs(r) * r,
        "u/V": u / np.hypot(speed, 0.01), "v/V": v / np.hypot(speed, 0.01),
        "sign r": r / np.hypot(r, 0.1), "cos": np.cos(psi), "sin": np.sin(psi),
        "sum": total, "difference": difference, "sum u": total * u, "sum v": total * v,
        "difference u": difference * u,
    }  # fmt: skip


def library(equation):
    extra = [t for ts in EFFECTS.values() for e, t in ts if e == equation]
    return NOMINAL[equation] + [t for t in extra if t not in NOMINAL[equation]]


def fit(features, rates, names, nominal, threshold):
    """Coefficients of the scaled terms; those of the nominal model are not thresholded."""
    scale = features.std(axis=0) + np.abs(features.mean(axis=0))
    scaled = features / scale / rates.std()
    always = [names.index(n) for n in nominal]
    optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
    optimizer.fit(scaled * rates.std(), rates[:, None] / rates.std())
    kept = np.flatnonzero(optimizer.coef_[0]).tolist()
    kept = sorted(set(kept) | set(always))
    found = np.linalg.lstsq(features[:, kept], rates, rcond=None)[0]
    coefficients = np.zeros(len(names))
    coefficients[kept] = found
    return coefficients


def name_effect(case):
    """The effect of a case, and {term: coefficient} for each equation."""
    best = None
    for width in WIDTHS:
        differentiate = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": width})
        data = [
            (terms(r["nu"], r["psi"], r["inputs"]), differentiate._differentiate(r["nu"], r["dt"]))
            for r in case
        ]
        for threshold in THRESHOLDS:
            error, sizes, found = 0.0, {}, []
            for equation in range(3):
                names = library(equation)
                F = [np.column_stack([t[n] for n in names]) for t, _ in data]
                y = [rates[:, equation] for _, rates in data]
                for out in range(len(case)):
                    rest = [i for i in range(len(case)) if i != out]
                    c = fit(np.vstack([F[i] for i in rest]), np.concatenate([y[i] for i in rest]),
                            names, NOMINAL[equation], threshold)  # fmt: skip
                    error += np.mean((F[out] @ c - y[out]) ** 2) / np.var(y[out])
                F, y = np.vstack(F), np.concatenate(y)
                c = fit(F, y, names, NOMINAL[equation], threshold)
                found.append(dict(zip(names, c)))
                for n, part in zip(names, (F * c).std(axis=0) + np.abs((F * c).mean(axis=0))):
                    sizes[equation, n] = part / y.std()
            if best is None or error < best[0]:
                best = (error, sizes, found)
    parts = {
        effect: np.sqrt(sum(best[1][t] ** 2 for t in ts if t[1] not in NOMINAL[t[0]]))
        for effect, ts in EFFECTS.items()
    }
    effect = max(parts, key=parts.get)
    return (effect if parts[effect] > 0 else "nothing"), best[2]


def main():
    warnings.filterwarnings("ignore")
    with open(sys.argv[1]) as file:
        cases = json.load(file)
    for runs in cases:
        case = [{name: np.array(value) for name, value in run.items()} for run in runs]
        begin = time.perf_counter()
        effect, _ = name_effect(case)
        print(json.dumps({"named": effect, "seconds": time.perf_counter() - begin}), flush=True)


if __name__ == "__main__":
    main()
