#!/usr/bin/python3
"""The fit of fit_speed.py with scipy.optimize.least_squares over a vectorised numpy simulation."""

import sys

import numpy as np
from scipy.optimize import least_squares

import fit_problem
from fit_problem import PARAMETERS

STEP = 1.5e-8  # step of finite differences, for variables of order one


def simulate(problem, theta, nu):
    """Velocities at the samples, samples x 3 x runs x columns.

    theta: 5 x columns, nu: 3 x runs x columns. Everything independent of the state is computed before
    the loop.
    """
    I_z, X_u, Y_v, N_r, k = theta
    m = problem.mass
    thrust = problem.inputs.transpose(1, 2, 0)[..., None] * k
    force = (thrust[:, 0] + thrust[:, 1]) / m
    moment = (thrust[:, 0] - thrust[:, 1]) * (problem.lever / I_z)
    damping = np.stack([X_u / m, Y_v / m, N_r / I_z])[:, None, :]
    drive = np.zeros(nu.shape)
    rate = np.empty((4,) + nu.shape)
    turn = np.zeros(nu.shape)
    h = problem.h

    def derivative(state, out):
        # (2.4) for equal masses
        np.multiply(state[2], state[1], out=turn[0])
        np.multiply(-state[2], state[0], out=turn[1])
        np.multiply(damping, state, out=out)
        np.subtract(turn, out, out=out)
        out += drive
        return out

    out = np.empty((problem.nu.shape[1],) + nu.shape)
    out[0] = nu
    for i in range(problem.inputs.shape[1]):
        drive[0], drive[2] = force[i], moment[i]
        derivative(nu, rate[0])
        derivative(nu + h / 2 * rate[0], rate[1])
        derivative(nu + h / 2 * rate[1], rate[2])
        derivative(nu + h * rate[2], rate[3])
        nu = nu + h / 6 * (rate[0] + 2 * (rate[1] + rate[2]) + rate[3])
        if (i + 1) % problem.stride == 0:
            out[(i + 1) // problem.stride] = nu
    return out


class Residuals:
    """Residuals and their Jacobian from one simulation in which every run has nine columns: one
    unperturbed, one for each parameter and one for each component of its initial velocity."""

    def __init__(self, problem):
        self.problem = problem
        self.x = None

    def update(self, x):
        if self.x is not None and np.array_equal(x, self.x):
            return
        p = self.problem
        runs, samples = p.nu.shape[:2]
        scaled = np.repeat(x[:PARAMETERS, None], 9, axis=1)
        nu = np.repeat(p.split(x)[1].T[:, :, None], 9, axis=2)
        for i in range(PARAMETERS):
            scaled[i, 1 + i] += STEP
        for i in range(3):
            nu[i, :, 1 + PARAMETERS + i] += STEP
        simulated = simulate(p, scaled * p.start[:, None], nu).transpose(2, 0, 1, 3)
        weights = p.weights[:, None, :]
        self.residuals = ((simulated[..., 0] - p.nu) * weights).ravel()
        slopes = (simulated[..., 1:] - simulated[..., :1]) * (weights[..., None] / STEP)
        jacobian = np.zeros((runs, samples * 3, x.size))
        jacobian[:, :, :PARAMETERS] = slopes[..., :PARAMETERS].reshape(runs, -1, PARAMETERS)
        for run in range(runs):
            at = PARAMETERS + 3 * run
            jacobian[run, :, at : at + 3] = slopes[run, ..., PARAMETERS:].reshape(-1, 3)
        self.jacobian = jacobian.reshape(-1, x.size)
        self.x = x.copy()

    def value(self, x):
        self.update(x)
        return self.residuals

    def slope(self, x):
        self.update(x)
        return self.jacobian


def fit(problem):
    residuals = Residuals(problem)
    common = dict(
        jac=residuals.slope, bounds=(problem.lower, problem.upper), x_scale="jac"
    )  # with x_scale, a fit that starts from 0.2 is 1.5 times as fast
    plain = least_squares(residuals.value, problem.x0, **common)
    width = problem.loss_width(plain.fun)
    robust = least_squares(residuals.value, plain.x, loss="soft_l1", f_scale=width, **common)
    return robust.x


if __name__ == "__main__":
    fit_problem.repeat(fit, fit_problem.Problem(sys.argv[1]), sys.argv[2])
