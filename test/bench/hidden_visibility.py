"""How much of a hidden effect the recordings can show at all.

Each effect acts alone in runs without a disturbance. The wrench that the nominal model lacks there
is compared, frequency by frequency, with the random wrench of the case and the noise of the poses.
What other values of the nominal parameters take over is projected out. The rest is the
noncentrality of a likelihood ratio test: the 2 ln L that the effect is worth on average.
"""
import numpy as np

import hidden_cases as cases
import hidden_craft
import hidden_noise

VISIBLE = 40.0  # 2 ln L that 99 of 100 tests see: p of 0.01 over 24 effects, three parameters
STEP = hidden_craft.COARSE  # of the grid of the spectra [s]
HIGHEST = hidden_noise.RATE / 2  # frequency that the poses tell [Hz]


def visibility(case):
    """{effect: 2 ln L} of everything that is hidden in a case, in the runs to fit to."""
    return {name: _noncentrality(case, {name: p}) for name, p in case.effects.items()}


def _noncentrality(case, effects):
    missing, columns = [], []
    for i in range(cases.FITTED):
        lack, takes_over, weight = _spectra(case, i, effects)
        missing.append((weight * lack).ravel())
        columns.append((weight[..., None] * takes_over).reshape(-1, takes_over.shape[-1]))
    y, A = np.concatenate(missing), np.vstack(columns)
    y, A = np.concatenate([y.real, y.imag]), np.vstack([A.real, A.imag])
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    rest = y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0]
    return float(rest @ rest)


def _spectra(case, i, effects):
    """Of one run: spectra of the missing wrench (f, 3) and of the wrench by each nominal parameter
    (f, 3, 5), and the weights (f, 3) that make squares log-likelihood ratios."""
    plan, body = cases.schedule(case.runs[i]["drive"]), case.body
    motion = cases.moved(case, i, plan, effects=effects)
    times = motion.times[motion.times <= plan.rows[-1, 0]]  # until the lift is off
    nu, nu_dot = (series[: len(times)] for series in hidden_craft.seen_motion(effects, motion))
    left, right = (hidden_craft.held_at((plan.rows[:, 0], plan.rows[:, c]), times) for c in (1, 2))
    zero, both, turn = np.zeros(len(times)), left + right, body["l"] * (left - right)
    u, v, r = nu.T
    by_parameter = [  # I_z, X_u, Y_v, N_r, k
        [zero, zero, -nu_dot[:, 2]],
        [-u, zero, zero],
        [zero, -v, zero],
        [zero, zero, -r],
        [both, zero, turn],
    ]
    inertia = np.array([body["m"], body["m"], body["I_z"]])
    nominal = [body["k"] * both - body["X_u"] * u, -body["Y_v"] * v]
    nominal.append(body["k"] * turn - body["N_r"] * r)
    lack = inertia * nu_dot - np.column_stack(nominal)
    takes_over = np.moveaxis(np.array(by_parameter), [0, 1, 2], [2, 1, 0])
    lack, takes_over = _sampled(times, lack), _sampled(times, takes_over)
    frequency = np.fft.rfftfreq(len(lack), STEP)
    told = frequency < HIGHEST
    density = _density(case.runs[i]["push"], case.mocap, inertia, frequency[told], len(lack) * STEP)
    weight = np.sqrt(2 * STEP / len(lack) / density)
    return np.fft.rfft(lack, axis=0)[told], np.fft.rfft(takes_over, axis=0)[told], weight


def _sampled(times, values):
    """Means over each STEP of what is held from each of the instants until the next."""
    steps = np.diff(times).reshape((-1,) + (1,) * (values.ndim - 1))
    integral = np.concatenate([0 * values[:1], np.cumsum(values[:-1] * steps, axis=0)])
    grid = np.arange(times[0], times[-1], STEP)
    flat = integral.reshape(len(times), -1).T
    at_grid = np.column_stack([np.interp(grid, times, column) for column in flat])
    return np.diff(at_grid, axis=0).reshape((-1,) + values.shape[1:]) / STEP


def _density(push, mocap, inertia, frequency, length):
    """Two-sided spectral density (f, 3) of the random wrench and of the poses' noise as a wrench;
    length: of the run [s]."""
    omega = 2 * np.pi * np.maximum(frequency, 0.5 / length)[:, None]
    sigma, time = np.array(push["sigma"]), np.array(push["time"])
    slow = 2 * sigma**2 * time / (1 + (omega * time) ** 2) + np.array(push["white"]) ** 2
    noise = mocap["level"] * hidden_noise.NOISE * inertia * omega**2
    return slow + noise**2 / hidden_noise.RATE
