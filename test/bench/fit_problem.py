"""The problem of fit_speed.py for scipy and JAX: nine runs, 5 parameters, 27 velocities.

Residuals are (simulated - measured) velocities over the run's standard deviations, samples by
channels. Unknowns are I_z, X_u, Y_v, N_r, k, each over its start value, then u, v, r at the start of
every run. As in SimulationError::fit, plain least squares come first; a fit with the pseudo-Huber loss
(scipy's soft_l1) starts from their result.
"""

import time

import numpy as np

PARAMETERS = 5


class Problem:
    """Measurements and inputs, all on one grid of RK4 steps.

    nu: runs x samples x 3, measured at every `stride`-th step from the start;
    inputs: runs x steps x 2, held over each step; weights: runs x 3.
    """

    def __init__(self, path):
        data = np.load(path)
        self.nu, self.inputs = data["nu"], data["inputs"]
        self.h, self.stride = float(data["h"]), int(data["stride"])
        self.mass, self.lever = float(data["mass"]), float(data["lever"])
        self.start = data["start"]
        self.weights = 1 / self.nu.std(axis=1)
        runs = len(self.nu)
        self.x0 = np.concatenate([np.ones(PARAMETERS), self.nu[:, 0].ravel()])
        lower = np.array([1e-6, 0, 0, 0, 1e-6])  # I_z and k cannot be zero, damping can
        self.lower = np.concatenate([lower, np.full(3 * runs, -np.inf)])
        self.upper = np.full(PARAMETERS + 3 * runs, np.inf)

    def split(self, x):
        """Parameters in SI units, and velocities at the start, runs x 3."""
        return x[:PARAMETERS] * self.start, x[PARAMETERS:].reshape(-1, 3)

    def loss_width(self, residuals):
        """Residual at which the robust loss changes from squares to absolute values."""
        return 2 * 1.4826 * np.median(np.abs(residuals))


def repeat(fit, problem, path):
    """Times `fit(problem) -> x` and writes parameters and times [s] to an .npz file."""
    fit(problem)
    times = []
    while len(times) < 7:
        begin = time.perf_counter()
        x = fit(problem)
        times.append(time.perf_counter() - begin)
    np.savez(path, theta=problem.split(x)[0], times=times)
