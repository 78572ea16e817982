"""Effects without a name measured by their truth: excess of the error, share of it that the effect causes,
and share of the effect that the library explains."""

import numpy as np

import hidden_craft
import hidden_effects
from ground import _core
from ground.analysis import window_error, windows
from ground.simulation import experiments

STEPS = 12  # largest number of Gauss-Newton steps
SMALL = 1e-4  # relative change of a parameter, change of a velocity, for derivatives


def excess(runs, model):
    """Error of the refitted nominal model relative to what the poses' noise alone leaves."""
    on = window_error.WindowFitter(runs, threads=1)
    fitted = windows.problem(runs, on.windows).fit(model, window_error.NOMINAL, threads=1)["model"]
    error = window_error.channel_errors(runs, on.windows, fitted).sum()
    return float(error / window_error.noise_floor(runs, fitted).sum())


def by_library(body, motions, wrenches):
    """Share of the power of a missing wrench that the nominal model and effects of the library explain by
    linear regression along the motions; moments count divided by the lever."""
    weight, y, A = np.array([1, 1, 1 / body["l"]]), [], []
    for motion, wrench in zip(motions, wrenches):
        few = np.linspace(0, len(wrench) - 1, 200).astype(int)
        y.append((weight * wrench[few]).ravel())
        columns = weight * np.array(_library(body, motion, few))
        A.append(columns.reshape(len(columns), -1).T)
    y, A = np.concatenate(y), np.vstack(A)
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    rest = y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0]
    return float(1 - rest @ rest / (y @ y))


def _library(body, motion, few):
    """Wrenches (n, 3) of unit size of the nominal parameters and of effects of the library."""
    u, v, r = motion.nu[few].T
    du, dv, dr = motion.nu_dot[few].T
    c, s, o = np.cos(motion.eta[few, 2]), np.sin(motion.eta[few, 2]), np.zeros(len(few))
    late = np.searchsorted(motion.times, motion.times[few] - 0.03).clip(0)
    thrust = motion.inputs[few, :2].T
    forces = [*thrust, *(thrust - motion.inputs[late, :2].T)]
    columns = [[f, o, side * body["l"] * f] for f, side in zip(forces, (1, -1, 1, -1))]
    columns += [[u, o, o], [o, v, o], [o, o, r], [o, o, dr]]
    columns += [[-du, -r * u, u * v], [r * v, -dv, -u * v]]  # added mass
    columns += [[r * r, -dr, -dv - u * r], [dr, r * r, du - v * r]]  # centre of mass
    columns += [[body["X_u"] * c, -body["Y_v"] * s, o], [body["X_u"] * s, body["Y_v"] * c, o]]  # wind
    columns = [np.column_stack(column) for column in columns]
    points = [_point(body, motion, i) for i in few]
    for name, sizes in hidden_effects.STRENGTHS.items():
        if name in hidden_craft.WRENCH:
            for one in sizes:
                p = {other: 0.1 * (other == one) for other in sizes}
                columns.append(np.array([hidden_craft.WRENCH[name](p, at) for at in points]))
        elif name in hidden_craft.THRUST:
            shares = np.array([hidden_craft.THRUST[name](sizes, at) for at in points]).T
            left, right = (shares - 1) * thrust
            columns.append(np.column_stack([left + right, o, body["l"] * (left - right)]))
    return columns


def _point(body, motion, i):
    """The hidden_craft.Point at a sample of a motion in still air."""
    at = hidden_craft.Point()
    at.t, at.m, at.l, at.com = motion.times[i] - experiments.LEAD, body["m"], body["l"], (0.0, 0.0)
    (at.x, at.y, at.psi), (at.u, at.v, at.r) = motion.eta[i].tolist(), motion.nu[i].tolist()
    at.ua, at.va, at.c, at.s = at.u, at.v, np.cos(at.psi), np.sin(at.psi)
    at.left, at.right, at.lift = motion.inputs[i].tolist()
    at.force_left, at.force_right = body["k"] * at.left, body["k"] * at.right
    return at


def explained(runs, heldout, model, motions, wrenches):
    """What the nominal model gains from the true missing wrench, when it is refitted without and with it.

    Returns the share of the mean squared error of velocities that vanishes, in windows of the runs to fit to
    and in each run's standard deviations; and the error of the runs held out, as `study` has it, without
    and with the wrench. motions, wrenches: of all runs, those held out last.
    """
    fitted = windows.problem(runs, windows.cut(runs)).fit(model, window_error.NOMINAL, threads=1)["model"]
    held = [_held(run.times, *pair) for run, pair in zip(runs + heldout, zip(motions, wrenches))]
    squares, errors = [], []
    for factor in (0.0, 1.0):
        acting = [factor * wrench for wrench in held]
        values, left = _fit(runs, model, fitted, acting[: len(runs)])
        squares.append(np.mean(np.concatenate(left) ** 2))
        best = fitted.copy()
        for name, value in zip(window_error.NOMINAL, values):
            best.set_value(name, value)
        _, left = _fit(heldout, model, best, acting[len(runs) :], free=0)
        errors.append(float(3 * np.mean(np.abs(np.concatenate(left)))))
    return float(1 - squares[1] / squares[0]), errors


def _held(times, motion, wrench):
    """Mean of a wrench from each sample to the next, (n, 3)."""
    whole = np.cumsum(wrench[:-1] * np.diff(motion.times)[:, None], axis=0)
    whole = np.vstack([np.zeros(3), whole])
    at = np.column_stack([np.interp(times, motion.times, column) for column in whole.T])
    mean = np.diff(at, axis=0) / np.diff(times)[:, None]
    return np.vstack([mean, mean[-1:]])


def _fit(runs, given, model, held, free=5):
    """Least squares of the velocities in windows by Gauss and Newton's method, from a fitted model, in units
    of the given one's parameters.

    The first `free` nominal parameters and the windows' initial velocities are fitted. Returns the
    parameters, and the error of each window in standard deviations.
    """
    chosen = windows.cut(runs)
    problem = windows.problem(runs, chosen)
    starts = [np.array(runs[w.run].nu[w.first]) for w in chosen]
    values = np.array([model.value(name) for name in window_error.NOMINAL])
    unit = np.array([given.value(name) for name in window_error.NOMINAL])

    def error(window, values, start):
        run, part = runs[window.run], slice(window.first, window.last + 1)
        changed = model.copy()
        for name, value in zip(window_error.NOMINAL, values):
            changed.set_value(name, value)
        nu = _core.simulate(changed, run.inputs, run.times[part], run.eta[window.first], start,
                            run.drives, held[window.run][part])["nu"]  # fmt: skip
        return ((nu - run.nu[part]) / problem.sigma(window.run)).ravel()

    def errors(values, starts):
        return [error(w, values, start) for w, start in zip(chosen, starts)]

    now = errors(values, starts)
    for _ in range(STEPS):
        turned, parts = [], []
        for w, e, start in zip(chosen, now, starts):
            by_value = [error(w, values + SMALL * unit * row, start) - e for row in np.eye(5)[:free]]
            by_start = [error(w, values, start + SMALL * row) - e for row in np.eye(3)]
            J = np.reshape(by_value, (free, len(e))).T / SMALL
            Q, R = np.linalg.qr(np.array(by_start).T / SMALL)
            parts.append((Q, R, J, e))
            turned.append(np.column_stack([J - Q @ (Q.T @ J), e - Q @ (Q.T @ e)]))
        whole = np.vstack(turned)
        step = np.linalg.lstsq(whole[:, :-1], -whole[:, -1], rcond=1e-10)[0]
        steps = [np.linalg.solve(R, -Q.T @ (e + J @ step)) for Q, R, J, e in parts]
        gained = 0.0
        for share in 0.5 ** np.arange(6):
            changed = values.copy()
            changed[:free] = np.maximum(0, changed[:free] + share * step * unit[:free])
            trial = changed, [s + share * d for s, d in zip(starts, steps)]
            try:
                there = errors(*trial)
            except RuntimeError:  # no finite motion
                continue
            gained = 1 - _square(there) / _square(now)
            if gained > 0:
                now, (values, starts) = there, trial
                break
        if gained < 1e-4:
            break
    return values, now


def _square(errors):
    return sum(e @ e for e in errors)
