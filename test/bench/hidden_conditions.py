"""Cases of a lab's conditions: mocap that smooths, late stamps, pilots in the loop, motors with a memory,
pushes that repeat, changes within a run, a body that sways.

Three runs of 12 s are diagnosed; three of 20 s, never given to the tool, judge what it says (hidden_judge).
The size of each condition is drawn over a wide range, so that its share of the error is small or large. A
third of the cases has an effect of the library beside it. Each has a random push.
"""

import numpy as np

import hidden_effects
from hidden_cases import FRAMES, LAGS, RIGHT, between, full_wrench, hide, plain, push, random_of
from hidden_effects import in_turn

FITTED = 3  # runs of a case that the tool gets; the others are fresh
DRIVEN, FRESH = 11.0, 19.0  # of these; a run has lift alone in its first second [s]
PUSH = (0.002, 0.03)  # level of the random push, relative to full thrust
BESIDE = 1 / 3  # share of cases with an effect of the library as well
SIZES = (1.5, 5.0)  # of this, relative to its strength
LIBRARY = (1.5, 8.0)  # the same where nothing else is hidden


def _begun(kind, seed, mocap=None, program=None, level=PUSH):
    """A case with its push, flown by schedule or by a program, and a generator for its sizes."""
    random = random_of(kind, seed, "condition")
    case = plain(kind, seed, "piloted" if program else "varied", mocap)
    _last(case)
    for run in case.runs:
        if program:
            run["drive"]["program"] = program
    if level:
        push(case, *level, FRAMES[random.integers(3)])
    if level == PUSH and random.uniform() < BESIDE:
        # A pilot's commands act at once.
        names = [name for name in hidden_effects.strengths() if not (program and name == "input_delay")]
        hide(case, [names[random.integers(len(names))]], *SIZES)
    return case, random


def _last(case):
    """Gives the runs their durations."""
    for i, run in enumerate(case.runs):
        run["driven"] = DRIVEN if i < FITTED else FRESH
    return case


def _with(case, name, parameters, allowed=()):
    """Gives the case an effect outside the library; allowed: effects that are right beside it."""
    case.effects[name] = {key: float(value) for key, value in parameters.items()}
    case.allowed = list(allowed)
    return case


def _smoothed(both):
    def make(kind, seed):
        cutoff = between(random_of(kind, seed, "mocap"), 1.0, 15.0)
        case, _ = _begun(kind, seed, {"cutoff": cutoff, "both": both})
        case.allowed = list(LAGS)
        return case

    return make


def _quantised_poses(kind, seed):
    step = between(random_of(kind, seed, "mocap"), 1.0, 20.0)
    return _begun(kind, seed, {"kind": "quantised", "level": 1 / 3, "step": step})[0]


def _late_stamps(kind, seed):
    """Stamps of commands are late by a constant, or by a different time each."""
    case, random = _begun(kind, seed)
    most = random.uniform(0.0, 0.1)
    case.stamps = [float(most if seed % 2 else most * random.uniform()), float(most)]
    case.allowed = list(LAGS)
    return case


def _piloted(program):
    return lambda kind, seed: _begun(kind, seed, program=program)[0]


def _rise_and_fall(kind, seed):
    case, random = _begun(kind, seed)
    slow = between(random, 0.01, 0.15)
    times = random.permutation([slow, slow * random.uniform(0.1, 0.6)])
    return _with(case, "spin_up", dict(zip(("rise", "fall"), times)), RIGHT["spin_up"])


def _dead_zone(kind, seed):
    case, random = _begun(kind, seed)
    start = between(random, 0.05, 0.35)
    return _with(case, "dead_zone", {"start": start, "stop": start * random.uniform(0.2, 0.9)})


def _slew(kind, seed):
    case, random = _begun(kind, seed)
    return _with(case, "slew", {"rate": between(random, 2.0, 20.0)}, RIGHT["slew"])


def _coarse_commands(kind, seed):
    case, random = _begun(kind, seed)
    return _with(case, "coarse_commands", {"steps": random.integers(3, 20)})


def _supply_sag(kind, seed):
    case, random = _begun(kind, seed)
    sag = {"part": between(random, 0.03, 0.4), "time": between(random, 0.2, 3.0)}
    return _with(case, "supply_sag", sag, RIGHT["supply_sag"])


def _phases(case, name, random):
    """Each run begins at another phase of an effect."""
    for run in case.runs:
        run["own"] = {name: {"phase": float(random.uniform(-np.pi, np.pi))}}
    return case


def _sweeping_fan(kind, seed):
    """Its mean acts as a tilted floor or a wind, which are right answers."""
    case, random = _begun(kind, seed)
    fan = {
        "force": between(random, 0.01, 0.15) * full_wrench(case)[0],
        "toward": random.uniform(-np.pi, np.pi),
        "sweep": random.uniform(0.3, 1.5),
        "period": between(random, 2.0, 10.0),
        "phase": 0.0,
    }
    return _phases(_with(case, "sweeping_fan", fan, ("floor_tilt", "wind")), "sweeping_fan", random)


def _hum(kind, seed):
    case, random = _begun(kind, seed)
    x, y, n = between(random, 0.01, 0.15) * random.normal(size=3) / np.sqrt(3) * full_wrench(case)
    hum = {"x": x, "y": y, "n": n, "frequency": between(random, 0.3, 6.0), "phase": 0.0}
    return _phases(_with(case, "hum", hum), "hum", random)


def _changed(kind, seed):
    """One thruster, both, the drag or a yaw moment change in the middle of each run; the mean change acts as
    a constant effect, which is a right answer."""
    what, _ = in_turn(seed, ("one", "drag", "both", "yaw"))
    case, random = _begun(kind, seed)
    when, part = random.uniform(0.3, 0.7), 1 - between(random, 0.03, 0.3)
    for run in case.runs:
        at = {"at": when * run["driven"]}
        run["own"] = {"later_wrench": at, "later_thrust": at}
    wrench = {"at": 0.0, "drag": 0.0, "moment": 0.0}
    if what == "drag":
        usual = np.sqrt(case.body["X_u"] * case.body["Y_v"])
        return _with(case, "later_wrench", dict(wrench, drag=usual * between(random, 0.2, 3.0)))
    if what == "yaw":
        moment = random.choice([-1, 1]) * between(random, 1e-5, 2e-4)
        return _with(case, "later_wrench", dict(wrench, moment=moment), ["yaw_bias"])
    thrust = {"at": 0.0, "left": part, "right": part if what == "both" else 1.0}
    return _with(case, "later_thrust", thrust, ["battery_sag" if what == "both" else "thrust_asymmetry"])


def _swaying(kind, seed):
    case, random = _begun(kind, seed)
    sway = {"lever": between(random, 0.005, 0.06), "frequency": between(random, 0.8, 4.0)}
    return _with(case, "sway", dict(sway, damping=between(random, 0.05, 0.4)))


def _nothing(kind, seed):
    """Nothing is missing: still air, a push of 5%, a person or a program that flies, in turn."""
    what, _ = in_turn(seed, ("still", "pushed", "still", "human", "place", "circle"))
    if what == "human":
        return push(_last(plain(kind, seed, "piloted")), *PUSH)
    if what in ("still", "pushed"):
        return _begun(kind, seed, level=(0.05, 0.05) if what == "pushed" else None)[0]
    return _begun(kind, seed, program=what, level=(0.002, 0.02))[0]


def _library(kind, seed):
    """An effect of the library, any of them, in a random push."""
    case, random = _begun(kind, seed, level=(0.001, 0.03))
    names = list(hidden_effects.strengths())
    turned = random_of(kind, (seed - 1) // len(names), "turn").permutation(names)
    return hide(case, [str(turned[(seed - 1) % len(names)])], *LIBRARY)


# The maker of the cases of each kind, and their default number.
KINDS = {
    "smoothed_late": (_smoothed(False), 3),
    "smoothed_both": (_smoothed(True), 3),
    "quantised_poses": (_quantised_poses, 3),
    "late_stamps": (_late_stamps, 3),
    "holds_place": (_piloted("place"), 3),
    "follows_path": (_piloted("circle"), 3),
    "rise_and_fall": (_rise_and_fall, 3),
    "dead_zone": (_dead_zone, 3),
    "slew": (_slew, 3),
    "coarse_commands": (_coarse_commands, 3),
    "supply_sag": (_supply_sag, 3),
    "sweeping_fan": (_sweeping_fan, 3),
    "hum": (_hum, 3),
    "changed": (_changed, 4),
    "swaying": (_swaying, 3),
    "nothing": (_nothing, 15),
    "library": (_library, 12),
}
