"""The fit of fit_speed.py with CasADi: exact sensitivities, a structured Levenberg-Marquardt loop.

CasADi takes the derivatives of one RK4 step; the step carries the sensitivities along
(mapaccum over time, map over runs), four times as fast as casadi.jacobian of a whole simulation.
Argument `compiled` lets CasADi write C and compile it with -O3, instead of interpreting it.
"""
import sys
import time

import casadi
import numpy as np

import fit_problem
from fit_problem import PARAMETERS

UNKNOWNS = PARAMETERS + 3  # parameters and the initial velocities of one run


def make_simulation(problem, compiled):
    """Function of all runs: ([nu; sensitivities] at the start, inputs, parameters) to [nu;
    sensitivities] at the samples."""
    x, nu, u = casadi.SX.sym("x", PARAMETERS), casadi.SX.sym("nu", 3), casadi.SX.sym("u", 2)
    I_z, X_u, Y_v, N_r, k = casadi.vertsplit(x * problem.start)
    m, lever, h = problem.mass, problem.lever, problem.h

    def derivative(nu):
        return casadi.vertcat(
            (k * (u[0] + u[1]) - X_u * nu[0]) / m + nu[2] * nu[1],
            -Y_v * nu[1] / m - nu[2] * nu[0],
            (lever * k * (u[0] - u[1]) - N_r * nu[2]) / I_z,
        )

    after = nu
    for _ in range(problem.stride):
        k1 = derivative(after)
        k2 = derivative(after + h / 2 * k1)
        k3 = derivative(after + h / 2 * k2)
        k4 = derivative(after + h * k3)
        after = after + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    S = casadi.SX.sym("S", 3, UNKNOWNS)
    moved = casadi.mtimes(casadi.jacobian(after, nu), S)
    moved[:, :PARAMETERS] += casadi.jacobian(after, x)
    step = casadi.Function(
        "step",
        [casadi.vertcat(nu, casadi.vec(S)), u, x],
        [casadi.vertcat(after, casadi.vec(moved))],
        {"cse": True},
    )
    options = {}
    if compiled:
        options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3"]}}
    return step.mapaccum("run", problem.nu.shape[1] - 1, options).map(len(problem.nu))


class Residuals:
    """Residuals, runs x samples x 3, and their Jacobian, runs x samples x 3 x UNKNOWNS."""

    def __init__(self, problem, compiled):
        self.problem = problem
        runs, samples = problem.nu.shape[:2]
        self.buffer, self.evaluate = make_simulation(problem, compiled).buffer()
        # CasADi reads and writes these in place, column by column.
        self.first = np.zeros((runs, 1 + UNKNOWNS, 3))
        self.first[:, 1 + PARAMETERS :] = np.eye(3)
        self.inputs = np.ascontiguousarray(problem.inputs[:, :: problem.stride])
        self.parameters = np.zeros((runs * (samples - 1), PARAMETERS))
        self.out = np.zeros((runs, samples - 1, 1 + UNKNOWNS, 3))
        for i, array in enumerate([self.first, self.inputs, self.parameters]):
            self.buffer.set_arg(i, memoryview(array))
        self.buffer.set_res(0, memoryview(self.out))

    def __call__(self, x):
        self.parameters[:] = x[:PARAMETERS]
        self.first[:, 0] = x[PARAMETERS:].reshape(-1, 3)
        self.evaluate()
        everything = np.concatenate([self.first[:, None], self.out], axis=1)
        everything[:, :, 0] -= self.problem.nu
        everything *= self.problem.weights[:, None, None, :]
        return everything[:, :, 0], everything[:, :, 1:].swapaxes(2, 3)


def robust(residuals, jacobian, width):
    """Residuals and Jacobian scaled so that the squares give the pseudo-Huber loss (Triggs et al. 2000,
    4.3)."""
    if np.isinf(width):
        return residuals, jacobian
    root = np.sqrt(1 + (residuals / width) ** 2)
    factor = np.sqrt(2 / (1 + root))
    return residuals * factor, jacobian * (factor * (1 - (root - 1) / (2 * root)))[..., None]


def minimise(residuals, x, problem, width=np.inf):
    """Levenberg-Marquardt; every run's velocity is eliminated from the normal equations."""

    def linearise(x):
        with np.errstate(over="ignore", invalid="ignore"):  # a diverging step is rejected
            r, J = robust(*residuals(x), width)
            r, J = r.reshape(len(r), -1), J.reshape(len(J), -1, UNKNOWNS)
            transposed = J.swapaxes(1, 2)
            return np.vdot(r, r) / 2, transposed @ J, (transposed @ r[..., None])[..., 0]

    def step(A, b, damping):
        A = A.copy()
        shared = A[:, :PARAMETERS, :PARAMETERS].sum(axis=0)
        shared[np.diag_indices(PARAMETERS)] *= 1 + damping
        own, mixed = A[:, PARAMETERS:, PARAMETERS:], A[:, PARAMETERS:, :PARAMETERS]
        own[:, range(3), range(3)] *= 1 + damping
        solved = np.linalg.solve(own, np.concatenate([mixed, b[:, PARAMETERS:, None]], axis=2))
        reduced = shared - np.sum(mixed.swapaxes(1, 2) @ solved[..., :PARAMETERS], axis=0)
        right = b[:, :PARAMETERS].sum(axis=0)
        right = right - np.sum(mixed.swapaxes(1, 2) @ solved[..., PARAMETERS:], axis=0)[:, 0]
        parameters = np.linalg.solve(reduced, right)
        velocities = solved[..., PARAMETERS] - solved[..., :PARAMETERS] @ parameters
        return -np.concatenate([parameters, velocities.ravel()])

    cost, A, b = linearise(x)
    damping = 1e-3
    for _ in range(100):
        trial = np.clip(x + step(A, b, damping), problem.lower, problem.upper)
        tried, trial_A, trial_b = linearise(trial)
        if not tried < cost:
            damping *= 8
            if damping > 1e12 or tried - cost <= 1e-10 * cost:
                break
            continue
        done = cost - tried < 1e-10 * cost
        x, cost, A, b = trial, tried, trial_A, trial_b
        damping = max(damping / 8, 1e-12)
        if done:
            break
    return x


def fit(problem, residuals):
    plain = minimise(residuals, problem.x0, problem)
    width = problem.loss_width(residuals(plain)[0])
    return minimise(residuals, plain, problem, width)


if __name__ == "__main__":
    problem = fit_problem.Problem(sys.argv[1])
    begin = time.perf_counter()
    residuals = Residuals(problem, compiled=sys.argv[3] == "compiled")
    fit_problem.repeat(
        lambda problem: fit(problem, residuals),
        problem,
        sys.argv[2],
        build=time.perf_counter() - begin,
        versions="CasADi %s, numpy %s" % (casadi.__version__, np.__version__),
    )
