"""Cases of the hidden-effect bench: hidden effects, disturbances, and measurement.

A case follows from its kind and seed alone. hidden_craft moves it, hidden_noise disturbs and
measures it: the estimator shares neither equations nor integrator nor noise with the truth. The
poses then take the path of a user's bag: they are repaired, smoothed and cut to the usable spans.
"""

import copy
import dataclasses
import functools
import hashlib
from dataclasses import asdict, dataclass, field

import numpy as np

import hidden_craft
import hidden_effects
import hidden_grammar
import hidden_inertial
import hidden_noise
import hidden_pilot
import hidden_share
from ground import _core
from ground.checks import quality
from ground.reading.recording import Recording
from ground.simulation import experiments
from ground.support.errors import GroundError
from hidden_effects import in_turn

FITTED, HELD_OUT = 4, 2  # runs of a case
DRIVEN = 7.0  # a run of 8 s has lift alone in its first second [s]
SPREAD = 0.2  # largest relative difference of the true body's parameters from the diagnosed model's
NOMINAL = ("m", "l", "I_z", "X_u", "Y_v", "N_r", "k")
FREE = NOMINAL[2:]
LEVELS = (0.01, 0.02, 0.05)  # sigma of the disturbance, relative to full thrust
TRIM = 0.03  # standard deviation from run to run, relative to full thrust or its moment
LAGS = ["input_delay", "motor_lag"]
# Effects of the library that are right for one that hidden_craft has by another name, or besides its own.
RIGHT = {
    "spin_up": [*LAGS, "motor_rise_fall"],
    "slew": [*LAGS, "motor_rate"],
    "supply_sag": ["supply_sag"],
    "thrust_droop": ["thrust_droop"],
}
# Effects with a memory, with the medians of their parameters, in SI units.
HISTORY = {
    "spin_up": {"rise": 0.06, "fall": 0.02},
    "thrust_droop": {"part": 0.2, "time": 1.5},
    "skirt_pressure": {"drag": 0.03, "time": 0.6, "speed": 1.0},
    "thrust_backlash": {"width": 0.2},
    "warm_up": {"part": 0.25, "use": 3.0},
}
EXCESS = (1.5, 12.0)  # range of a nameless effect's excess
MAX_BY_LIBRARY = 0.6  # share of a nameless effect that effects of the library may explain
EVERYWHERE = 0.3  # least size in each run of an effect that is not local, relative to that in all runs
FRAMES = ("body", "room", "both")
SIZE_FACTOR = 1.3  # sizes are drawn between median / SIZE_FACTOR and median * SIZE_FACTOR


@dataclass
class Case:
    """A true craft and the experiments with it; plain values in SI units."""

    kind: str
    seed: int
    hidden: list = field(default_factory=list)  # effects of the library in the truth
    allowed: list = field(default_factory=list)  # other effects that do not count as false
    effects: dict = field(default_factory=dict)  # all effects in the truth: {name: {parameter: value}}
    body: dict = field(default_factory=dict)  # true nominal parameters
    given: dict = field(default_factory=dict)  # factors on parameters of the diagnosed model
    runs: list = field(default_factory=list)  # drive, heading, push and thrust of each run
    mocap: dict = field(default_factory=dict)
    jitter: float = 0.0  # largest delay of single commands [s]
    level: float = 0.0  # sigma of the disturbance, relative to full thrust
    frame: str = "body"  # in which the disturbance keeps its direction: body, room or both
    imu: bool = False  # whether gyro and accelerometer were recorded
    stamps: list = field(default_factory=lambda: [0.0, 0.0])  # bounds of how late stamps of commands are [s]
    excess: float = 0.0  # error that a nameless effect causes, relative to the noise floor

    def describe(self):
        """The case as a dictionary for a line of JSON."""
        return asdict(self)


def random_of(*parts):
    """A random generator seeded by names, so that each use has independent numbers."""
    return np.random.default_rng(int(hashlib.sha256(repr(parts).encode()).hexdigest()[:16], 16))


def plain(kind, seed, excitation="varied", mocap=None):
    """A case without hidden effects and disturbance: only the poses are noisy."""
    random = random_of(kind, seed, "body")
    given = _core.load_model(hidden_effects.MODEL)
    case = Case(kind, seed, body={name: given.value(name) for name in NOMINAL})
    for name in FREE:
        case.body[name] *= random.uniform(1 - SPREAD, 1 + SPREAD)
    case.mocap = {"kind": "white", "level": 1.0, "time": 0.0, "jitter": 0.0, **(mocap or {})}
    drives = _drives(random_of(kind, seed, "drive"), excitation)
    calm = {"sigma": [0.0] * 3, "time": [1.0] * 3, "white": [0.0] * 3, "trim": [0.0] * 3}
    for drive in drives:
        heading = random.uniform(-np.pi, np.pi)
        run = {"drive": drive, "heading": heading, "thrust": 0.0}
        case.runs.append(dict(run, push={name: list(values) for name, values in calm.items()}))
    return case


def _drives(random, excitation):
    """Drives of the runs. `thesis`: a PRBS as in the recordings of 2019; `levels`: many levels in every
    run; `piloted`: by hand; `varied`: clocks, levels and lift differ from run to run, every eighth case
    is `thesis`."""
    if excitation == "piloted":
        lifts = random.choice([1.0, 1.0, 0.85, 0.7], FITTED + HELD_OUT).tolist()
        return [{"input": "pilot", "lift": lift, "number": _number(random)} for lift in lifts]
    if excitation == "thesis" or (excitation == "varied" and random.uniform() < 1 / 8):
        return [_prbs(random, 10, (0.0, 1.0), 1.0) for _ in range(FITTED + HELD_OUT)]
    lifts = list(random.permutation([1.0, 1.0, 0.85, 0.7])) + [1.0, 0.85]
    drives = []
    for i, lift in enumerate(lifts):
        if excitation == "levels" or i % 3 == 0:
            hold = random.uniform(0.15, 0.5)
            drive = {"input": "levels", "hold": hold, "lift": lift, "number": _number(random)}
            drives.append(drive)
            continue
        clock = int(random.choice([5, 8, 10, 15, 20]))
        levels = [(0.0, 1.0), (0.2, 0.8), (0.0, 0.6), (0.1, 0.9), (0.3, 1.0)]
        drives.append(_prbs(random, clock, levels[random.integers(len(levels))], lift))
    return drives


def _prbs(random, clock, levels, lift):
    shared = {"input": "prbs", "clock": clock, "levels": list(levels)}
    return dict(shared, lift=lift, number=_number(random))


def _number(random):
    return int(random.integers(1, 10**6))


def schedule(drive, driven=DRIVEN):
    """The experiments.Schedule of a drive of some seconds; a pilot's has the lift alone."""
    if drive["input"] == "pilot":
        rows = np.zeros((1, 3))
    elif drive["input"] == "prbs":
        clock, levels = drive["clock"], drive["levels"]
        rows = experiments.rows("prbs", driven, clock=clock, levels=levels, seed=drive["number"])
    else:
        random = random_of("levels", drive["number"])
        edges = np.arange(0, driven, drive["hold"])
        rows = np.column_stack([edges, random.choice(np.linspace(0, 1, 6), (len(edges), 2))])
    return experiments.with_lift(rows, driven, drive["lift"])


def push(case, low, high, frame="body"):
    """Adds a random wrench with a level in [low, high], relative to the full wrench.

    Its force keeps its direction in the body, in the room, or has a part in both. It is an
    Ornstein-Uhlenbeck process with a correlation time of 0.1 to 3 s. In half of the cases level and time
    differ from run to run; a quarter of the cases has a white part, too.
    """
    random = random_of(case.kind, case.seed, "push")
    case.level, case.frame = between(random, low, high), frame
    full = full_wrench(case)
    differ, white = random.uniform() < 0.5, random.uniform() < 0.25
    level, times = case.level, _times(random)
    for run in case.runs:
        if differ:
            level, times = between(random, low, high), _times(random)
        run["push"]["sigma"] = (level * full).tolist()
        run["push"]["time"] = times
        if white:  # the density at low frequency equals that of a correlation time of 10 ms
            run["push"]["white"] = (level * full * np.sqrt(0.02)).tolist()
        if frame != "body":
            _turn_to_room(run["push"], random, frame)
    return case


def _turn_to_room(push, random, frame):
    """Moves the force of a disturbance, or a random part of it (`both`), from the body to the room."""
    share = np.sqrt(random.uniform(0.2, 0.8)) if frame == "both" else 1.0
    left = np.sqrt(1 - share**2)
    push["room"] = {"time": push["time"][:2], "trim": [0.0, 0.0]}
    for part in ("sigma", "white"):
        push["room"][part] = [share * size for size in push[part][:2]]
        push[part] = [left * size for size in push[part][:2]] + push[part][2:]


def full_wrench(case):
    """Largest force (two components) and moment of the thrusters [N, N, N m]."""
    k = case.body["k"]
    return np.array([2 * k, 2 * k, k * case.body["l"]])


def _times(random):
    force, yaw = between(random, 0.1, 3.0), between(random, 0.1, 3.0)
    return [force, force, yaw]


def between(random, low, high):
    """A number in [low, high], log-uniformly distributed."""
    drawn = random.uniform(np.log(low), np.log(high))
    return low if low == high else float(np.exp(drawn))


def hide(case, names, low, high):
    """Adds effects of the library at their strength times a factor drawn from [low, high]."""
    random = random_of(case.kind, case.seed, "effects", *names)
    for name in names:
        factor, case.effects[name] = random.uniform(low, high), {}
        for parameter, size in hidden_effects.strengths()[name].items():
            sign = 1 if name in hidden_effects.ONE_SIDED else random.choice([-1, 1])
            value = hidden_effects.scaled(name, parameter, size, float(sign * factor))
            case.effects[name][parameter] = value
    case.hidden = sorted(case.hidden + list(names))
    return case


def trim(case, what):
    """Makes yaw moment, side force, thrust or a constant draught in the room differ from run to run."""
    random = random_of(case.kind, case.seed, "trim")
    for run in case.runs:
        size = float(TRIM * random.normal())
        if what == "thrust":
            run["thrust"] = size
        elif what == "draught":
            calm = {"sigma": [0.0] * 2, "white": [0.0] * 2, "time": [1.0] * 2}
            force = float(full_wrench(case)[0]) * np.array([size, TRIM * random.normal()])
            run["push"].setdefault("room", calm)["trim"] = force.tolist()
        else:
            channel = {"side": 1, "yaw": 2}[what]
            run["push"]["trim"][channel] = size * float(full_wrench(case)[channel])
    # The mean over the runs acts as a constant effect, which is a right answer.
    means = {"yaw": ["yaw_bias"], "side": ["body_force_bias"], "draught": ["floor_tilt", "wind"]}
    case.allowed = means.get(what, [])
    return case


def hide_nameless(case, local=False):
    """Adds an effect that the grammar draws, of a size at which the refitted nominal model's error is a
    random multiple of the noise floor. Draws again what cannot reach it, what the library explains, and what
    hardly acts in some run if it is not local."""
    random = random_of(case.kind, case.seed, "nameless")
    wanted = between(random, *EXCESS)
    motions = [flight(calmed(case), i)[1] for i in range(len(case.runs))]
    columns = zip(*(hidden_grammar.columns(m, experiments.LEAD) for m in motions))
    sample = dict(zip(hidden_grammar.VARIABLES, map(np.concatenate, columns)))
    sample = {name: values[sample["t"] > 1][::10] for name, values in sample.items()}
    while True:
        effect = hidden_grammar.draw(random, sample, case.body, local)
        wrenches = _along(effect, motions)
        sizes = [np.sqrt(np.mean((wrench / full_wrench(case)) ** 2)) for wrench in wrenches]
        size = np.sqrt(np.mean(np.square(sizes)))
        if not 1e-9 < size < 1e9 or (not local and min(sizes) < EVERYWHERE * size):
            continue
        if hidden_share.by_library(case.body, motions, wrenches) < MAX_BY_LIBRARY:
            sized = hidden_grammar.scaled(effect, 0.002 * wanted / size)
            if _reach(case, sized, wanted, motions):
                return case


def _along(effect, motions):
    """Wrenches (n, 3) of a nameless effect along the motions of the runs."""
    along = hidden_grammar.along
    return [along(effect, i, motion, experiments.LEAD) for i, motion in enumerate(motions)]


def _reach(case, effect, wanted, motions):
    """Gives a nameless effect to the case, at the size of the wanted excess; whether it succeeded."""
    fastest = 2.5 * np.max([np.abs(motion.nu).max(axis=0) for motion in motions], axis=0)
    size, low, high = effect["constants"]["a"], 0.0, np.inf
    for _ in range(10):
        case.effects["nameless"] = hidden_grammar.scaled(effect, size)
        case.excess = _excess(calmed(case), fastest)
        if abs(np.log(case.excess / wanted)) < 0.07:
            case.excess = round(case.excess, 3)
            return True
        low, high = (size, high) if case.excess < wanted else (low, size)
        grow = np.sqrt((wanted**2 - 1) / max(case.excess**2 - 1, 0.02))
        size *= np.clip(grow, 0.1, 10)  # the excess grows as the square at first
        if not low < size < high:
            size = np.sqrt(low * high) if low else high / 5
    return False


def _excess(case, fastest):
    """The excess of a case without disturbance; infinite if the craft runs away."""
    try:
        runs = [record_run(case, i) for i in range(FITTED)]
        if any((np.abs(run.nu).max(axis=0) > fastest).any() for run in runs):
            return np.inf
        return hidden_share.excess(runs, given_model(case))
    except (ArithmeticError, ValueError, GroundError):
        return np.inf


def calmed(case):
    """The case without disturbance, differences between runs, and jitter."""
    calm = copy.deepcopy(case)
    calm.jitter = 0.0
    for run in calm.runs:
        run.update(thrust=0.0, push={n: [0.0] * 3 for n in ("sigma", "white", "trim")})
    return calm


# --- The kinds


def disturbed_null(kind, seed):
    return push(plain(kind, seed), 0.005, 0.05)


def noise_null(kind, seed):
    mocap, _ = in_turn(seed, [{"level": 0.5}, {"level": 1.0}, {"level": 2.0}, {"jitter": 3e-4}])
    return plain(kind, seed, mocap=mocap)


def odd_noise(kind, seed):
    mocap = {"kind": in_turn(seed, ["coloured", "heavy", "spikes", "quantised"])[0]}
    if mocap["kind"] == "coloured":
        mocap["time"] = between(random_of(kind, seed), 0.03, 0.1)
    if mocap["kind"] == "quantised":
        mocap["level"] = 1 / 3
    return plain(kind, seed, mocap=mocap)


def wrong_givens(kind, seed):
    """Mass and lever arm of the diagnosed model are wrong; half of the cases have a disturbance."""
    case = plain(kind, seed)
    case.given = {"m": 1.08, "l": 0.93}
    return push(case, 0.005, 0.02) if seed % 2 else case


def jittered_link(kind, seed):
    """Each command has its own random delay of up to 30 ms."""
    case = push(plain(kind, seed), 0.001, 0.01)
    case.jitter, case.allowed = 0.03, list(LAGS)
    return case


def single(low, high):
    """A maker of cases with one effect in a disturbance: each effect in turn, at each level."""

    def make(kind, seed):
        name, level, _ = in_turn(seed, hidden_effects.strengths(), LEVELS)
        return hide(push(plain(kind, seed), level, level), [name], low, high)

    return make


TRIMS = ("yaw", "side", "thrust")


def trim_null(kind, seed):
    return trim(push(plain(kind, seed), 0.001, 0.01), in_turn(seed, TRIMS)[0])


def trim_single(kind, seed):
    """A trim and one effect, but not the effect that equals the mean of the trim."""
    what, turn = in_turn(seed, TRIMS)
    case = trim(push(plain(kind, seed), 0.001, 0.01), what)
    names = [name for name in hidden_effects.strengths() if name not in case.allowed]
    return hide(case, in_turn(turn, names)[:1], 1.5, 2.5)


def _calm_or_not(kind, seed):
    """A disturbance of none, 0.5% and 1% of full thrust in turn."""
    level, _ = in_turn(seed, (0.0, 0.005, 0.01))
    return push(plain(kind, seed), level, level) if level else plain(kind, seed)


def twins(kind, seed):
    """Two effects that look nearly alike; delay and lag are 20 ms each."""
    pair, _ = in_turn(in_turn(seed, range(3))[-1], hidden_effects.LOOK_ALIKES)
    case = hide(_calm_or_not(kind, seed), sorted(pair), 1.5, 2.5)
    if "motor_lag" in pair:
        case.effects = {"input_delay": {"delay": 0.02}, "motor_lag": {"tau": 0.02}}
    return case


def several(count):
    """A maker of cases with `count` random effects, which may be twins."""

    def make(kind, seed):
        known = list(hidden_effects.strengths())
        names = random_of(kind, seed, "names").choice(known, count, replace=False).tolist()
        return hide(_calm_or_not(kind, seed), names, 1.5, 2.5)

    return make


def history(kind, seed):
    """A thrust or drag that depends on the past."""
    name, is_calm, _ = in_turn(seed, HISTORY, (True, False))
    case = plain(kind, seed, "levels" if name == "thrust_backlash" else "varied")
    if not is_calm:
        push(case, 0.001, 0.01)
    random = random_of(kind, seed, "sizes")
    sizes = {n: between(random, s / SIZE_FACTOR, s * SIZE_FACTOR) for n, s in HISTORY[name].items()}
    case.effects[name] = sizes
    case.allowed = list(RIGHT.get(name, []))
    return case


def unequal_delays(kind, seed):
    case, random = _calm_or_not(kind, seed), random_of(kind, seed, "delays")
    delays = [random.uniform(0.005, 0.015), random.uniform(0.02, 0.04)]
    case.effects["unequal_delays"] = dict(zip(("left", "right"), random.permutation(delays)))
    case.allowed = list(LAGS)
    return case


def nameless(local):
    """A maker of cases with an effect from the grammar, a third of them without a disturbance."""

    def make(kind, seed):
        random = random_of(kind, seed, "circumstances")
        case = plain(kind, seed, "piloted" if random.uniform() < 0.25 else "varied")
        if random.uniform() > 1 / 3:
            push(case, 0.005, 0.02, FRAMES[random.integers(2)])
        return hide_nameless(case, local)

    return make


def null(kind, seed):
    """Nothing is missing, whatever disturbs, differs between runs, drives the craft or measures it."""
    random = random_of(kind, seed, "circumstances")
    mocap = {}
    if random.uniform() < 0.2:
        mocap = {"kind": "coloured", "time": between(random, 0.03, 0.1)}
    case = plain(kind, seed, "piloted" if random.uniform() < 0.4 else "varied", mocap)
    push(case, 0.005, 0.05, FRAMES[random.integers(3)])
    if random.uniform() < 0.3:
        trim(case, (*TRIMS, "draught")[random.integers(4)])
    return case


def draught(kind, seed):
    """A tilted floor or a wind under a disturbance that keeps its direction in the room."""
    name, _ = in_turn(seed, ("floor_tilt", "wind"))
    return hide(push(plain(kind, seed), 0.005, 0.03, "room"), [name], 1.5, 2.5)


# The maker of the cases of each kind, and their default number.
KINDS = {
    "disturbed_null": (disturbed_null, 400),
    "noise_null": (noise_null, 100),
    "odd_noise": (odd_noise, 100),
    "wrong_givens": (wrong_givens, 100),
    "jittered_link": (jittered_link, 60),
    "disturbed_single": (single(1.5, 2.5), 12 * len(hidden_effects.strengths())),
    "weak_single": (single(1.1, 1.1), 3 * len(hidden_effects.strengths())),
    "trim": (trim_null, 90),
    "trim_single": (trim_single, 120),
    "twins": (twins, 90),
    "pairs": (several(2), 500),
    "triples": (several(3), 200),
    "history": (history, 100),
    "unequal_delays": (unequal_delays, 60),
    "nameless": (nameless(False), 100),
    "local": (nameless(True), 60),
    "null": (null, 200),
    "draught": (draught, 60),
}


def make(kind, seed):
    """The Case of a kind and a seed."""
    return KINDS[kind][0](kind, seed)


# --- Its recordings


def record(case):
    """Recordings of a case: runs to fit to and runs held out, lists of _core.RunData."""
    runs = [record_run(case, i) for i in range(len(case.runs))]
    return runs[:FITTED], runs[FITTED:]


@dataclass
class Flown:
    """A run, how it was moved and how it was recorded; times on a clock that is 0 where the recording
    begins."""

    recording: Recording
    motion: hidden_craft.Motion
    frames: np.ndarray  # (n,) when poses were taken [s]
    exact: np.ndarray  # (n, 3) poses of these without noise, not smoothed
    sent: np.ndarray  # (m, 4) commands as they were recorded: time, left, right, lift
    end: float  # of the recording [s]


def record_run(case, i):
    """One run of a case as _core.RunData."""
    return quality.repaired(fly(case, i).recording).data(given_model(case))


def fly(case, i):
    """One run of a case as it was Flown."""
    random = _noise(case, i)
    plan, motion = flight(case, i, random)
    taken, stamps = hidden_noise.frames(random, plan.end, case.mocap)
    poses = exact(case, motion, taken)
    eta = hidden_noise.measured(random, poses, case.mocap)
    sent = plan.rows.copy()
    if any(case.stamps):
        late = random_of(case.kind, case.seed, "stamps", i).uniform(*case.stamps, len(sent))
        sent[:, 0] = np.maximum.accumulate(sent[:, 0] + late)
    recording = Recording(
        "run %d" % (i + 1),
        experiments.START + stamps,
        eta,
        experiments.START + sent[:, 0],
        sent[:, 1:],
        "hidden_craft",
    )
    if case.imu:
        sensed = random_of(case.kind, case.seed, "imu", i)
        samples = hidden_inertial.samples(sensed, motion, plan.end, experiments.START)
        recording = dataclasses.replace(recording, inertial=samples)
    return Flown(recording, motion, taken, poses, sent, plan.end)


def exact(case, motion, times):
    """Poses (n, 3) that a motion capture without noise sees at some times (n,) [s]."""
    poses = motion.poses(np.maximum(times, motion.times[0]))
    if "sway" in case.effects:
        poses[:, :2] += hidden_craft.sway(case.effects["sway"], motion, times)
    return hidden_craft.seen(case.effects, poses)


def _noise(case, i):
    """The random generator of a run's disturbance and measurement."""
    return random_of(case.kind, case.seed, "noise", i)


def flight(case, i, random=None, effects=None):
    """The commands of a run (experiments.Schedule), and its hidden_craft.Motion from the first lift on.
    Without `random` there is no disturbance and no jitter; `effects` replaces the effects of the truth."""
    run, effects = case.runs[i], acting_effects(case, i) if effects is None else effects
    if run["thrust"]:
        effects = {**effects, "thrust_scale": {"a": run["thrust"]}}
    if "nameless" in effects:
        effects = {**effects, "nameless": {**effects["nameless"], "run": i}}
    plan, pilot = schedule(run["drive"], run.get("driven", DRIVEN)), None
    if run["drive"]["input"] == "pilot":
        steers, program = random_of("pilot", run["drive"]["number"]), run["drive"].get("program")
        which = functools.partial(hidden_pilot.Autopilot, circles=program == "circle")
        pilot = (which if program else hidden_pilot.Pilot)(steers, *plan.rows[-2:, 0])
    began = plan.rows[np.argmax(plan.rows[:, 3] > 0), 0]
    sent, wrench = plan.rows, None
    if random is not None and case.jitter:
        late = random.uniform(0, case.jitter, len(sent))
        arrive = np.maximum.accumulate(sent[:, 0] + late)
        sent = [(arrive, sent[:, column]) for column in (1, 2, 3)]
    if random is not None and _pushes(run["push"]):
        count = int(np.ceil((plan.end - began) / hidden_craft.GRID)) + 1
        wrench = hidden_noise.wrench(random, count, hidden_craft.GRID, run["push"])
    craft = hidden_craft.Craft(case.body, effects)
    commands = hidden_craft.acting(effects, sent)
    pose = (0.0, 0.0, run["heading"])
    motion = hidden_craft.simulate(craft, commands, plan.end, pose, began, wrench, pilot=pilot)
    if pilot:
        steered = np.insert(pilot.rows, 3, run["drive"]["lift"], axis=1)
        plan.rows = np.vstack([plan.rows[:-2], steered, plan.rows[-1:]])
    return plan, motion


def acting_effects(case, i):
    """The effects in one run: of some, parameters differ from run to run."""
    own = case.runs[i].get("own", {})
    return {name: {**p, **own.get(name, {})} for name, p in case.effects.items()}


def _pushes(push):
    return "room" in push or any(map(any, (push[name] for name in ("sigma", "white", "trim"))))


def truth_about(case, fitted, heldout):
    """The truth about a nameless effect: `explained_true`, the share of the error in the runs to fit to that
    vanishes with its wrench; `learnable_true`, the same, or 0 if the recorded motion and the time do not
    determine it; `errors_true` of the runs held out, without and with its wrench; its formula."""
    effect = case.effects["nameless"]
    motions = [flight(case, i, _noise(case, i))[1] for i in range(len(case.runs))]
    wrenches = _along(effect, motions)
    share, errors = hidden_share.explained(fitted, heldout, given_model(case), motions, wrenches)
    learnable = share if effect["repeats"] else 0.0
    found = {"explained_true": share, "learnable_true": learnable, "errors_true": errors}
    return dict(found, formula=hidden_grammar.text(effect))


def given_model(case):
    """The nominal _core.Model, which is diagnosed."""
    model = _core.load_model(hidden_effects.MODEL)
    for name, factor in case.given.items():
        model.set_value(name, model.value(name) * factor)
    return model


def true_value(case, name):
    """True value of a parameter of the diagnosed model. None for nominal parameters with wrong givens.
    An effect that is not in the truth has its neutral value."""
    effect, _, parameter = name.partition(".")
    if not parameter:
        return None if case.given else case.body[name]
    if effect in case.effects:
        return case.effects[effect][parameter]
    return hidden_effects.neutral(name)
