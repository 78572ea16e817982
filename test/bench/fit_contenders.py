"""The fit of fit_speed.py as one would write it without ground: run by it, in its environment.

Both simulate the velocities with RK4 at 5 ms, samples every second step. The parameters are scaled
to order one and solved for 1 / I_z, as ground does: from 0.2 each neither finds the way otherwise.
"""
import json
import sys
import time

import numpy as np
import scipy
from scipy.optimize import least_squares

STEP, SUBSTEPS = 0.005, 2
SCALE = np.array([1 / 1e-3, 0.2, 0.2, 0.2, 0.2])  # 1/I_z, X_u, Y_v, N_r, k


class Problem:
    def __init__(self, path):
        data = np.load(path)
        self.nu, self.repeats = data["nu"], int(data["repeats"])
        self.m, self.l = data["body"]
        self.sigma = self.nu.std(axis=1)
        per_bit = int(round(1 / float(data["clock"]) / STEP))
        self.u = np.repeat(data["inputs"], per_bit, axis=1)  # (runs, steps, 2)
        self.runs = len(self.nu)
        self.start = np.concatenate(
            [np.array([5, 0.2, 0.2, 0.2, 0.2]) / SCALE, self.nu[:, 0].ravel()]
        )
        self.lower = np.concatenate([[1e-6, 0, 0, 0, 1e-6], np.full(3 * self.runs, -np.inf)])

    def solve(self, residuals, jacobian):
        found = least_squares(
            residuals,
            self.start,
            jacobian,
            bounds=(self.lower, np.inf),
            x_scale=1.0,
            ftol=1e-8,
            xtol=1e-8,
            gtol=1e-10,
        )
        values = found.x[:5] * SCALE
        return [1 / values[0]] + list(values[1:])


def by_numpy(problem):
    """All runs and all perturbed parameters at once; a run's own initial velocity moves only it."""
    delta = 1e-6

    def simulate(theta, nu):
        """theta (n, 5) scaled, nu (n, runs, 3): residuals (n, runs, samples, 3)."""
        inertia, x_u, y_v, n_r, k = ((theta * SCALE).T)[:, :, None]
        m, length = problem.m, problem.l

        def rates(s, thrust, turn):
            u, v, r = s[..., 0], s[..., 1], s[..., 2]
            out = np.empty_like(s)
            out[..., 0] = k / m * thrust + r * v - x_u / m * u
            out[..., 1] = -r * u - y_v / m * v
            out[..., 2] = inertia * (k * length * turn - n_r * r)
            return out

        states = [nu]
        for step in range(problem.u.shape[1]):
            thrust = problem.u[:, step, 0] + problem.u[:, step, 1]
            turn = problem.u[:, step, 0] - problem.u[:, step, 1]
            k1 = rates(nu, thrust, turn)
            k2 = rates(nu + STEP / 2 * k1, thrust, turn)
            k3 = rates(nu + STEP / 2 * k2, thrust, turn)
            k4 = rates(nu + STEP * k3, thrust, turn)
            nu = nu + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
            if step % SUBSTEPS == SUBSTEPS - 1:
                states.append(nu)
        out = (np.stack(states, axis=2) - problem.nu) / problem.sigma[:, None, :]
        return np.nan_to_num(out, nan=1e6, posinf=1e6, neginf=-1e6)

    def split(x):
        return x[:5], x[5:].reshape(problem.runs, 3)

    def residuals(x):
        theta, nu = split(x)
        with np.errstate(all="ignore"):
            return simulate(theta[None], nu[None])[0].ravel()

    def jacobian(x):
        theta, nu = split(x)
        thetas, nus = np.tile(theta, (9, 1)), np.tile(nu, (9, 1, 1))
        for i in range(5):
            thetas[1 + i, i] += delta
        for i in range(3):
            nus[6 + i, :, i] += delta
        with np.errstate(all="ignore"):
            found = simulate(thetas, nus)
        slopes = (found[1:] - found[0]) / delta  # (8, runs, samples, 3)
        J = np.zeros((problem.runs, found.shape[2] * 3, 5 + 3 * problem.runs))
        for i in range(5):
            J[:, :, i] = slopes[i].reshape(problem.runs, -1)
        for run in range(problem.runs):
            J[run, :, 5 + 3 * run : 8 + 3 * run] = slopes[5:, run].reshape(3, -1).T
        return J.reshape(-1, J.shape[2])

    return lambda: problem.solve(residuals, jacobian)


def by_casadi(problem):
    """Exact derivatives of the same, built once."""
    import casadi

    p, s, u = casadi.SX.sym("p", 5), casadi.SX.sym("s", 3), casadi.SX.sym("u", 2)
    scaled = p * SCALE
    inertia, x_u, y_v, n_r, k = (scaled[i] for i in range(5))

    def rates(s):
        return casadi.vertcat(
            k / problem.m * (u[0] + u[1]) + s[2] * s[1] - x_u / problem.m * s[0],
            -s[2] * s[0] - y_v / problem.m * s[1],
            inertia * (k * problem.l * (u[0] - u[1]) - n_r * s[2]),
        )

    at = s
    for _ in range(SUBSTEPS):  # the input is held over a sample
        k1 = rates(at)
        k2 = rates(at + STEP / 2 * k1)
        k3 = rates(at + STEP / 2 * k2)
        k4 = rates(at + STEP * k3)
        at = at + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
    samples = problem.u.shape[1] // SUBSTEPS
    run = casadi.Function("sample", [s, p, u], [at]).mapaccum("run", samples)
    parameters, initial = casadi.MX.sym("p", 5), casadi.MX.sym("nu", 3)
    inputs, measured = casadi.MX.sym("u", 2, samples), casadi.MX.sym("m", 3, samples + 1)
    states = run(initial, casadi.repmat(parameters, 1, samples), inputs)
    misfit = casadi.vec(casadi.horzcat(initial, states) - measured)
    unknown = casadi.vertcat(parameters, initial)
    both = casadi.Function(
        "both", [parameters, initial, inputs, measured], [misfit, casadi.jacobian(misfit, unknown)]
    )
    alone = casadi.Function("alone", [parameters, initial, inputs, measured], [misfit])
    us = [problem.u[i, ::SUBSTEPS].T for i in range(problem.runs)]
    ms = [problem.nu[i].T for i in range(problem.runs)]
    weight = [np.tile(1 / problem.sigma[i], samples + 1) for i in range(problem.runs)]
    rows = 3 * (samples + 1)

    def clean(a):
        return np.nan_to_num(a, nan=1e6, posinf=1e6, neginf=-1e6)

    def residuals(x):
        return clean(
            np.concatenate(
                [
                    np.asarray(alone(x[:5], x[5 + 3 * i : 8 + 3 * i], us[i], ms[i])).ravel()
                    * weight[i]
                    for i in range(problem.runs)
                ]
            )
        )

    def jacobian(x):
        J = np.zeros((problem.runs * rows, len(x)))
        for i in range(problem.runs):
            own = slice(5 + 3 * i, 8 + 3 * i)
            part = np.asarray(both(x[:5], x[own], us[i], ms[i])[1].full()) * weight[i][:, None]
            J[i * rows : (i + 1) * rows, :5] = part[:, :5]
            J[i * rows : (i + 1) * rows, own] = part[:, 5:]
        return clean(J)

    return lambda: problem.solve(residuals, jacobian)


def timed(work, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        values = work()
        times.append(time.perf_counter() - start)
    return {"seconds": times, "values": values}


def main():
    problem = Problem(sys.argv[1])
    results = {"scipy over vectorised numpy": timed(by_numpy(problem), problem.repeats)}
    versions = "numpy %s, scipy %s" % (np.__version__, scipy.__version__)
    try:
        import casadi

        versions += ", CasADi %s" % casadi.__version__
        results["scipy over CasADi's derivatives"] = timed(by_casadi(problem), problem.repeats)
    except ImportError:
        pass
    print(json.dumps({"results": results, "versions": versions}))


if __name__ == "__main__":
    main()
