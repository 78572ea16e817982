"""Visibility of hidden effects: the expected 2 ln L of each in the recordings.

Each effect acts alone in runs without a disturbance. At each frequency the missing wrench of the nominal
model is divided by the level of the case's random wrench and pose noise. The part that other values of
the nominal parameters explain is projected out. The rest is the noncentrality of a likelihood ratio
test: the mean gain in 2 ln L by the effect.
"""
import numpy as np

import hidden_cases as cases
import hidden_craft
import hidden_noise

# Noncentrality that 99 of 100 tests detect (three parameters, p of 0.01 corrected for 24 effects).
VISIBLE = 40.0
STEP = hidden_craft.COARSE  # time step of the spectra [s]
MAX_FREQUENCY = hidden_noise.RATE / 2  # Nyquist frequency of the poses [Hz]


def visibility(case):
    """{effect: 2 ln L} of all effects in a case's truth, over the runs to fit to."""
    return {name: _noncentrality(case, {name: p}) for name, p in case.effects.items()}


def _noncentrality(case, effects):
    wrenches, columns = [], []
    for i in range(cases.FITTED):
        missing, by_parameter, weight = _spectra(case, i, effects)
        wrenches.append((weight * missing).ravel())
        columns.append((weight[..., None] * by_parameter).reshape(-1, by_parameter.shape[-1]))
    y, A = np.concatenate(wrenches), np.vstack(columns)
    y, A = np.concatenate([y.real, y.imag]), np.vstack([A.real, A.imag])
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    rest = y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0]
    return float(rest @ rest)


def _spectra(case, i, effects):
    """Spectra of one run: of the missing wrench (f, 3), and of the wrench's derivatives by the nominal
    parameters (f, 3, 5); and the weights (f, 3) that turn squares into log-likelihood ratios."""
    body = case.body
    plan, motion = cases.flight(case, i, effects=effects)
    times = motion.times[motion.times <= plan.rows[-1, 0]]  # until the lift is off
    nu, nu_dot = (series[: len(times)] for series in hidden_craft.seen_motion(effects, motion))
    left, right = (hidden_craft.held_at((plan.rows[:, 0], plan.rows[:, c]), times) for c in (1, 2))
    zero, both, turn = np.zeros(len(times)), left + right, body["l"] * (left - right)
    u, v, r = nu.T
    derivatives = [  # by I_z, X_u, Y_v, N_r, k
        [zero, zero, -nu_dot[:, 2]],
        [-u, zero, zero],
        [zero, -v, zero],
        [zero, zero, -r],
        [both, zero, turn],
    ]
    inertia = np.array([body["m"], body["m"], body["I_z"]])
    nominal = [body["k"] * both - body["X_u"] * u, -body["Y_v"] * v]
    nominal.append(body["k"] * turn - body["N_r"] * r)
    missing = _sampled(times, inertia * nu_dot - np.column_stack(nominal))
    by_parameter = _sampled(times, np.moveaxis(np.array(derivatives), [0, 1, 2], [2, 1, 0]))
    count = len(missing)
    frequency = np.fft.rfftfreq(count, STEP)
    low = frequency < MAX_FREQUENCY
    density = _density(case.runs[i]["push"], case.mocap, inertia, frequency[low], count * STEP)
    weight = np.sqrt(2 * STEP / count / density)
    return np.fft.rfft(missing, axis=0)[low], np.fft.rfft(by_parameter, axis=0)[low], weight


def _sampled(times, values):
    """Means over each STEP of a piecewise constant signal with the given values from each time on."""
    steps = np.diff(times).reshape((-1,) + (1,) * (values.ndim - 1))
    integral = np.concatenate([0 * values[:1], np.cumsum(values[:-1] * steps, axis=0)])
    grid = np.arange(times[0], times[-1], STEP)
    flat = integral.reshape(len(times), -1).T
    at_grid = np.column_stack([np.interp(grid, times, column) for column in flat])
    return np.diff(at_grid, axis=0).reshape((-1,) + values.shape[1:]) / STEP


def _density(push, mocap, inertia, frequency, length):
    """Two-sided spectral density (f, 3) of the random wrench plus the pose noise, expressed as a wrench;
    length of the run in s."""
    omega = 2 * np.pi * np.maximum(frequency, 0.5 / length)[:, None]
    slow = _slow(push, omega)
    if "room" in push:
        slow[:, :2] += _slow(push["room"], omega)
    noise = mocap["level"] * hidden_noise.NOISE * inertia * omega**2
    return slow + noise**2 / hidden_noise.RATE


def _slow(push, omega):
    """Spectral density of a random wrench (f, channels)."""
    sigma, time = np.array(push["sigma"]), np.array(push["time"])
    return 2 * sigma**2 * time / (1 + (omega * time) ** 2) + np.array(push["white"]) ** 2
