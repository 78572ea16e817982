"""Simulated experiments: what drives the craft, and the recording that comes of it.

An input schedule is an array of rows time [s], left, right, lift (0..1), each held until the next.
Everything runs in process, without ROS, and depends on nothing but its arguments.
"""
import math
from dataclasses import dataclass, field

import numpy as np

from ground import _core
from ground.errors import IdentifyError
from ground.recordings.recording import Recording

START = 1000.0  # stamp at which every simulated recording starts [s]
LEAD = 0.5  # recorded at rest, before the lift is on [s]
TAIL = 0.5  # recorded after the thrusters are off [s]
LONGEST = 3600.0  # that an input may last [s]
CLOCK = 15.0  # bits per second of a binary sequence [Hz]
GOLDEN = 0.6180339887498949


@dataclass
class SimulatedRun(Recording):
    """A recording and what only a simulator knows of it; all times on the recording's clock."""

    delivered: np.ndarray = field(default=None)  # (n,) when the poses came in [s]
    truth_times: np.ndarray = field(default=None)  # (k,) [s]: every frame, also those lost
    truth_eta: np.ndarray = field(default=None)  # (k, 3) x, y [m], psi [rad], world_ned
    truth_nu: np.ndarray = field(default=None)  # (k, 3) u, v [m/s], r [rad/s], body
    truth_nu_dot: np.ndarray = field(default=None)  # (k, 3) their derivatives
    truth_wrench: np.ndarray = field(default=None)  # (k, 3) disturbance: X, Y [N], N [N m], body
    references: np.ndarray = field(default=None)  # (j, 9) time, p, p_dot, p_ddot, p_dddot
    stopped: str = ""  # why the controller stopped before its end


@dataclass
class Schedule:
    """What an open-loop controller plays: rows of time, left, right, lift, until `end` [s]."""

    rows: np.ndarray
    end: float


def prbs(duration, clock=CLOCK, levels=(0.0, 1.0), order=9, seed=1):
    """Rows time, left, right of a maximum-length binary sequence of 2^order - 1 bits.

    The seed says where in its period the sequence starts, far apart for neighbouring seeds. Raises
    ValueError on an order outside 2..20.
    """
    start = int(seed * GOLDEN % 1 * (2**order - 1))
    return bits(_core.make_prbs(order, start), duration, clock, levels)


def bits(sequence, duration, clock=CLOCK, levels=(0.0, 1.0), rows_per_bit=1):
    """Rows time, left, right of pairs (left, right), `rows_per_bit` of which make a bit, at `clock`
    bits per second [Hz], repeated as often as needed."""
    low, high = levels
    row_rate = clock * rows_per_bit
    edges = np.arange(math.ceil(duration * row_rate - 1e-9))
    chosen = np.array(sequence, bool)[edges % len(sequence)]
    return np.column_stack([edges / row_rate, np.where(chosen, high, low)])


def steps(duration, hold=1.0, levels=(0.0, 0.25, 0.5, 0.75, 1.0)):
    """Both thrusters through the levels in turn, each held for `hold` [s]."""
    return _pattern([(level, level) for level in levels], duration, hold)


def coast_down(duration, hold=1.0, levels=(0.0, 1.0)):
    """Both thrusters high for `hold` [s], then low for three times that, again and again."""
    low, high = levels
    return _pattern([(high, high)] + 3 * [(low, low)], duration, hold)


def spin(duration, hold=1.0, levels=(0.0, 1.0)):
    """Left high for `hold` [s], then both low for three times that; then the right one alike."""
    low, high = levels
    return _pattern(
        [(high, low)] + 3 * [(low, low)] + [(low, high)] + 3 * [(low, low)], duration, hold
    )


def single_thruster(duration, hold=1.0, levels=(0.0, 1.0)):
    """The left thruster alone through the levels, each held for `hold` [s], then the right one."""
    pairs = [(level, 0.0) for level in levels] + [(0.0, level) for level in levels]
    return _pattern(pairs, duration, hold)


def _pattern(pairs, duration, hold):
    count = math.ceil(duration / hold - 1e-9)
    inputs = np.array([pairs[i % len(pairs)] for i in range(count)], float)
    return np.column_stack([hold * np.arange(count), inputs])


def with_lift(rows, duration, lift=1.0, lift_time=1.0):
    """The schedule of an open-loop run from rows of time, left, right: rest, lift alone for
    `lift_time` [s], the rows for `duration` [s], then everything off."""
    lifted = np.column_stack([rows[:, 0] + lift_time, rows[:, 1:3], np.full(len(rows), lift)])
    return as_given(np.vstack([(0.0, 0, 0, lift), lifted]), lift_time + duration)


def as_given(rows, duration):
    """The schedule of rows of time, left, right, lift that end after `duration` [s]: rest before
    them, everything off after them."""
    end = LEAD + duration
    rows = rows + [LEAD, 0, 0, 0]
    off = [(0.0, 0, 0, 0), (end, 0, 0, 0)]
    return Schedule(np.vstack([off[:1], rows[rows[:, 0] < end], off[1:]]), end + TAIL)


def disturbance_in_shares(model, share=0.0, time=0.0, trim=0.0):
    """A _core.Disturbance in shares of what the craft's thrusters can do.

    The unit of X and Y is full thrust, 2 k input_max; that of N is the moment of one thruster alone,
    k l input_max. share: standard deviation of a wrench whose correlation time is `time` [s]; trim:
    standard deviation, from run to run, of a constant wrench and of the factor on the thrust.
    """
    force = model.value("k") * model.input_max
    unit = np.array([2 * force, 2 * force, force * model.value("l")])
    found = _core.Disturbance()
    found.sigma, found.time = share * unit, np.full(3, float(time))
    found.trim, found.trim_thrust = trim * unit, trim
    return found


def simulate(
    model,
    drive,
    name="simulated",
    pose=(0, 0, 0),
    velocity=(0, 0, 0),
    mocap=None,
    seed=1,
    believed=None,
    disturbance=None,
):
    """Runs an experiment and gives its SimulatedRun.

    drive: a Schedule, or _core.TrackingParams for the tracking controller in the loop, which then
    believes in the model `believed` (by default the one that moves the craft). pose: initial x, y
    [m], psi [rad], world_ned; velocity: initial u, v [m/s], r [rad/s], body. mocap:
    _core.MocapParams. disturbance: _core.Disturbance that acts on the craft, drawn by the seed; that
    of the model does not act by itself. Raises ValueError on bad parameters, IdentifyError when
    nothing can be recorded or the motion is not finite.
    """
    mocap = _core.MocapParams() if mocap is None else mocap
    where = [np.array(pose, float), np.array(velocity, float), mocap, seed]
    if disturbance is not None:
        where.append(disturbance)
    try:
        if isinstance(drive, Schedule):
            log = _core.play_schedule(model, drive.rows, drive.end, *where)
        else:
            log = _core.track_reference(model, believed or model, drive, *where)
    except RuntimeError as error:
        raise IdentifyError("%s: %s" % (name, error))
    frames, commands, truth = log["frames"], log["commands"], log["truth"]
    if len(frames) < 2:
        raise IdentifyError(
            "%s: only %d of %d mocap frames were delivered; there is nothing to record"
            % (name, len(frames), len(truth))
        )
    references = log["references"]
    references[:, 0] += START
    return SimulatedRun(
        name=name,
        pose_times=START + frames[:, 0],
        eta=frames[:, 2:],
        control_times=START + commands[:, 0],
        controls=commands[:, 1:],
        source="simulated with %s" % model.name,
        delivered=START + frames[:, 1],
        truth_times=START + truth[:, 0],
        truth_eta=truth[:, 1:4],
        truth_nu=truth[:, 4:7],
        truth_nu_dot=truth[:, 7:10],
        truth_wrench=truth[:, 10:],
        references=references,
        stopped=log["stopped"],
    )


def read_schedule(path, rows_per_bit=0):
    """A CSV file of inputs: bits, or rows with a header time,left,right or time,left,right,lift.

    Gives ("bits", _core.PrbsFile), or ("timed", rows) without and ("lifted", rows) with a column lift.
    `rows_per_bit` rows make a bit, 0: as many as the file shows. Raises IdentifyError that names file
    and line.
    """
    try:
        with open(path) as file:
            lines = file.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise IdentifyError("%s: cannot be read (%s)" % (path, error))
    header = [cell.strip() for cell in lines[0].split(",")] if lines else []
    if header[:1] == ["time"]:
        rows = _timed_rows(path, header, lines)
        return ("lifted" if rows.shape[1] == 4 else "timed"), rows
    try:
        return "bits", _core.read_prbs(path, rows_per_bit)
    except RuntimeError as error:
        raise IdentifyError(
            "%s; a schedule needs a first line time,left,right or time,left,right,lift" % error
        )


def _timed_rows(path, header, lines):
    if header not in (["time", "left", "right"], ["time", "left", "right", "lift"]):
        raise IdentifyError(
            "%s, line 1: the columns are %s, not time,left,right or time,left,right,lift"
            % (path, ",".join(header))
        )
    rows = []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        where = "%s, line %d" % (path, number)
        try:
            row = [float(cell) for cell in line.split(",")]
        except ValueError:
            raise IdentifyError("%s: '%s' is not all numbers" % (where, line))
        if len(row) != len(header):
            raise IdentifyError("%s: %d values for %d columns" % (where, len(row), len(header)))
        if not all(math.isfinite(value) for value in row):
            raise IdentifyError("%s: a value is not finite" % where)
        if row[0] < 0 or (rows and row[0] <= rows[-1][0]):
            raise IdentifyError("%s: times have to grow from 0 or more on" % where)
        if min(row[1:]) < 0 or max(row[1:]) > 1:
            raise IdentifyError("%s: inputs have to be between 0 and 1" % where)
        rows.append(row)
    if len(rows) < 2:
        raise IdentifyError("%s: only %d rows" % (path, len(rows)))
    if rows[-1][0] > LONGEST:
        raise IdentifyError(
            "%s: the last time is %g s, but inputs may last %g s; they are counted from the run's "
            "start" % (path, rows[-1][0], LONGEST)
        )
    return np.array(rows)
