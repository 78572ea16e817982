"""The fit of fit_speed.py with JAX: exact forward sensitivities, the whole search compiled by XLA.

The sensitivities of all runs go through one scan over time, in float64. Velocities are separate arrays
over the runs, so that XLA fuses a step into few loops. The search runs inside two `while_loop`s,
without returns to Python.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import fit_problem
from fit_problem import PARAMETERS

MAX_ITERATIONS = 100


def make_fit(problem):
    """The compiled fit: x at the start to x at the optimum."""
    start, weights = jnp.asarray(problem.start), jnp.asarray(problem.weights)
    measured = jnp.asarray(problem.nu)
    inputs = jnp.asarray(problem.inputs[:, :: problem.stride].transpose(1, 2, 0))
    lower, upper = jnp.asarray(problem.lower), jnp.asarray(problem.upper)
    m, lever, h = problem.mass, problem.lever, problem.h

    def move(parameters, nu, u):
        """RK4 steps from one sample to the next."""
        I_z, X_u, Y_v, N_r, k = [parameters[i] * start[i] for i in range(PARAMETERS)]
        surge, yaw = k * (u[0] + u[1]) / m, lever * k * (u[0] - u[1]) / I_z

        def derivative(nu):
            return (
                surge - X_u / m * nu[0] + nu[2] * nu[1],
                -Y_v / m * nu[1] - nu[2] * nu[0],
                yaw - N_r / I_z * nu[2],
            )

        def along(nu, rate, step):
            return tuple(a + step * b for a, b in zip(nu, rate))

        for _ in range(problem.stride):
            k1 = derivative(nu)
            k2 = derivative(along(nu, k1, h / 2))
            k3 = derivative(along(nu, k2, h / 2))
            k4 = derivative(along(nu, k3, h))
            nu = tuple(a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(nu, k1, k2, k3, k4))
        return nu

    def simulate(parameters, first):
        """Velocities (samples, 3, runs) for parameters (5, runs), which are the same in all runs."""

        def step(nu, u):
            nu = move(parameters, nu, u)
            return nu, jnp.stack(nu)

        first = tuple(first)
        _, rest = lax.scan(step, first, inputs)  # unrolled by 4 it is five times slower
        return jnp.concatenate([jnp.stack(first)[None], rest])

    def residuals(x):
        """Residuals (runs, samples x 3) and their Jacobian (runs, samples x 3, 8 unknowns)."""
        runs = measured.shape[0]
        parameters = jnp.broadcast_to(x[:PARAMETERS, None], (PARAMETERS, runs))
        first = x[PARAMETERS:].reshape(runs, 3).T
        directions = jnp.eye(PARAMETERS + 3)[:, :, None] * jnp.ones(runs)

        def along(direction):
            tangents = direction[:PARAMETERS], direction[PARAMETERS:]
            return jax.jvp(simulate, (parameters, first), tangents)

        nu, slopes = jax.vmap(along, out_axes=(None, -1))(directions)
        r = (nu.transpose(2, 0, 1) - measured) * weights[:, None]
        J = slopes.transpose(2, 0, 1, 3) * weights[:, None, :, None]
        return r.reshape(runs, -1), J.reshape(runs, r[0].size, -1)

    def robust(r, J, width):
        root = jnp.sqrt(1 + (r / width) ** 2)
        factor = jnp.sqrt(2 / (1 + root))
        return r * factor, J * (factor * (1 - (root - 1) / (2 * root)))[..., None]

    def linearise(x, width):
        r, J = robust(*residuals(x), width)
        return jnp.vdot(r, r) / 2, jnp.einsum("rki,rkj->rij", J, J), jnp.einsum("rki,rk->ri", J, r)

    def solve(A, b, damping):
        """A damped step; every run's velocity is eliminated from the normal equations."""
        P = PARAMETERS
        shared = A[:, :P, :P].sum(axis=0)
        shared = shared + damping * jnp.diag(jnp.diag(shared))
        own, mixed = A[:, P:, P:], A[:, P:, :P]
        own = own + damping * own * jnp.eye(3)
        solved = jnp.linalg.solve(own, jnp.concatenate([mixed, b[:, P:, None]], axis=2))
        reduced = shared - jnp.einsum("rki,rkj->ij", mixed, solved[..., :P])
        right = b[:, :P].sum(axis=0) - jnp.einsum("rki,rk->i", mixed, solved[..., P])
        parameters = jnp.linalg.solve(reduced, right)
        velocities = solved[..., P] - solved[..., :P] @ parameters
        return -jnp.concatenate([parameters, velocities.ravel()])

    def minimise(x, width):
        """Levenberg-Marquardt."""

        def iterate(state):
            x, cost, A, b, damping, count, _ = state
            trial = jnp.clip(x + solve(A, b, damping), lower, upper)
            tried, trial_A, trial_b = linearise(trial, width)
            better = tried < cost
            worse = jnp.where(better, damping, damping * 8)
            done = jnp.where(
                better, cost - tried < 1e-10 * cost, (worse > 1e12) | (tried - cost <= 1e-10 * cost)
            )
            taken = trial, tried, trial_A, trial_b, jnp.maximum(damping / 8, 1e-12)
            kept = x, cost, A, b, worse
            state = [jnp.where(better, one, other) for one, other in zip(taken, kept)]
            return (*state, count + 1, done)

        state = (x, *linearise(x, width), 1e-3, 0, False)
        return lax.while_loop(lambda s: ~s[6] & (s[5] < MAX_ITERATIONS), iterate, state)[0]

    def fit(x):
        plain = minimise(x, jnp.inf)
        width = 2 * 1.4826 * jnp.median(jnp.abs(residuals(plain)[0]))
        return minimise(plain, width)

    return jax.jit(fit)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    problem = fit_problem.Problem(sys.argv[1])
    compiled = make_fit(problem).lower(jnp.asarray(problem.x0)).compile()
    fit_problem.repeat(lambda problem: np.asarray(compiled(problem.x0)), problem, sys.argv[2])
