"""Effects without a name measured by their truth: excess of the error, share of it that the effect causes,
and share of the effect that the library explains."""
import numpy as np

import hidden_craft
import hidden_white
from ground import _core
from ground.analysis import study
from ground.recordings import windows
from ground.simulation import experiments

STEPS = 12  # largest number of Gauss-Newton steps
SMALL = 1e-4  # relative change of a parameter, change of a velocity, for derivatives


def excess(runs, model):
    """Error of the refitted nominal model relative to what the poses' noise alone leaves."""
    on = study.Study(runs, threads=1)
    fitted = windows.problem(runs, on.windows).fit(model, study.NOMINAL, threads=1)["model"]
    error = study.channel_errors(runs, on.windows, fitted).sum()
    return float(error / study.noise_floor(runs, fitted).sum())


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
    for name, sizes in hidden_white.STRENGTHS.items():
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


def explained(runs, model, motions, wrenches):
    """Share of the squared error of velocities, over the windows of the reports and in each run's standard
    deviations, that vanishes when the nominal model gets the true missing wrench. Its parameters and the
    initial velocities are fitted without and with the wrench. Returns the share, and the root mean square
    error without and with it."""
    on = study.Study(runs, threads=1)
    fitted = windows.problem(runs, on.windows).fit(model, study.NOMINAL, threads=1)["model"]
    held = [_held(run.times, *pair) for run, pair in zip(runs, zip(motions, wrenches))]
    before, after = (_least(runs, on.windows, fitted, [f * w for w in held]) for f in (0.0, 1.0))
    return 1 - after / before, float(np.sqrt(before)), float(np.sqrt(after))


def _held(times, motion, wrench):
    """Mean of a wrench from each sample to the next, (n, 3)."""
    whole = np.cumsum(wrench[:-1] * np.diff(motion.times)[:, None], axis=0)
    whole = np.vstack([np.zeros(3), whole])
    at = np.column_stack([np.interp(times, motion.times, column) for column in whole.T])
    mean = np.diff(at, axis=0) / np.diff(times)[:, None]
    return np.vstack([mean, mean[-1:]])


def _least(runs, chosen, model, held):
    """Least mean squared error of the velocities by Gauss and Newton's method, from a fitted model."""
    sigma = windows.problem(runs, chosen)
    starts = [np.array(runs[w.run].nu[w.first]) for w in chosen]
    values = np.array([model.value(name) for name in study.NOMINAL])

    def error(window, values, start):
        run, part = runs[window.run], slice(window.first, window.last + 1)
        changed = model.copy()
        for name, value in zip(study.NOMINAL, values):
            changed.set_value(name, value)
        nu = _core.simulate(changed, run.inputs, run.times[part], run.eta[window.first], start,
                            run.drives, held[window.run][part])["nu"]  # fmt: skip
        return ((nu - run.nu[part]) / sigma.sigma(window.run)).ravel()

    def errors(values, starts):
        return [error(w, values, start) for w, start in zip(chosen, starts)]

    now = errors(values, starts)
    for _ in range(STEPS):
        turned, parts = [], []
        for w, e, start in zip(chosen, now, starts):
            by_value = [error(w, values * (1 + SMALL * row), start) - e for row in np.eye(5)]
            by_start = [error(w, values, start + SMALL * row) - e for row in np.eye(3)]
            J, K = np.array(by_value).T / SMALL, np.array(by_start).T / SMALL
            Q, R = np.linalg.qr(K)
            parts.append((Q, R, J, e))
            turned.append(np.column_stack([J - Q @ (Q.T @ J), e - Q @ (Q.T @ e)]))
        whole = np.vstack(turned)
        step = np.linalg.lstsq(whole[:, :-1], -whole[:, -1], rcond=1e-10)[0]
        steps = [np.linalg.solve(R, -Q.T @ (e + J @ step)) for Q, R, J, e in parts]
        for share in 0.5 ** np.arange(6):
            trial = values * np.exp(share * step), [s + share * d for s, d in zip(starts, steps)]
            there = errors(*trial)
            if _mean(there) < _mean(now):
                break
        else:
            break
        gained, now, (values, starts) = 1 - _mean(there) / _mean(now), there, trial
        if gained < 1e-4:
            break
    return _mean(now)


def _mean(errors):
    return float(np.mean(np.concatenate(errors) ** 2))
