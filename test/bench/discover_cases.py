"""Crafts of the discovery bench: one hidden effect, several, none, or what the library does not have."""

from dataclasses import asdict, dataclass, field

import numpy as np

import hidden_cases
import hidden_effects
from ground import _core
from hidden_cases import random_of
from hidden_effects import in_turn

SPREAD = 0.3  # largest relative difference of the true body's parameters from the given model's
LEVEL = 0.005  # sigma of the disturbance, relative to full thrust
FACTORS = (1.5, 2.5)  # range of an effect's size, relative to hidden_effects.STRENGTHS
# Effects outside the library: the arguments that they depend on, as a diagnosis names them.
OUTSIDE = {**{name: depends for name, (_, _, depends) in hidden_effects.OUTSIDE.items()}}
OUTSIDE["floor_field"] = {"place"}
MEMORY = {
    "spin_up": {"past", "command"},
    "thrust_droop": {"past", "command"},
    "skirt_pressure": {"past", "velocity", "command"},
    "thrust_backlash": {"past", "command"},
    "warm_up": {"past", "command", "time"},
}


@dataclass
class Case:
    """A true craft; plain values in SI units."""

    kind: str
    seed: int
    hidden: list = field(default_factory=list)  # effects of the library in the truth
    allowed: list = field(default_factory=list)  # other effects that do not count as false
    effects: dict = field(default_factory=dict)  # all effects: {name: {parameter: value}}
    body: dict = field(default_factory=dict)  # true nominal parameters
    depends: list = field(default_factory=list)  # arguments of an effect that the library does not have
    level: float = LEVEL  # sigma of the disturbance, relative to full thrust
    push: dict = field(default_factory=dict)  # the disturbance, as hidden_noise.wrench has it
    gaps: bool = False  # whether the mocap fails now and then

    def describe(self):
        """The case as a dictionary for a line of JSON."""
        return asdict(self)


def plain(kind, seed):
    """A craft without hidden effects, in a disturbance."""
    random, given = random_of(kind, seed, "body"), given_model()
    case = Case(kind, seed, body={name: given.value(name) for name in hidden_cases.NOMINAL})
    for name in hidden_cases.FREE:
        case.body[name] *= random.uniform(1 - SPREAD, 1 + SPREAD)
    calm = [0.0] * 3
    force, yaw = (float(np.exp(random.uniform(np.log(0.1), np.log(3.0)))) for _ in range(2))
    sigma = (LEVEL * hidden_cases.full_wrench(case)).tolist()
    case.push = {"sigma": sigma, "time": [force, force, yaw], "white": calm, "trim": calm}
    return case


def given_model():
    """The nominal _core.Model, which a discovery begins with."""
    return _core.load_model(hidden_effects.MODEL)


def one(kind, seed):
    return hidden_cases.hide(plain(kind, seed), in_turn(seed, hidden_effects.strengths())[:1], *FACTORS)


def several(count):
    """A maker of crafts with `count` random effects, which may look alike."""

    def make(kind, seed):
        known = list(hidden_effects.strengths())
        names = random_of(kind, seed, "names").choice(known, count, replace=False).tolist()
        return hidden_cases.hide(plain(kind, seed), names, *FACTORS)

    return make


def outside(kind, seed):
    """An effect that no effect of the library expresses."""
    case, random = plain(kind, seed), random_of(kind, seed, "sizes")
    name = in_turn(seed, OUTSIDE)[0]
    if name == "floor_field":
        case.effects[name] = {
            "force": 2 * case.body["k"] * random.uniform(0.03, 0.08),
            "length": random.uniform(1.0, 2.5),
            "phase": random.uniform(0, 2 * np.pi),
        }
    else:
        sizes = hidden_effects.OUTSIDE[name][1]
        case.effects[name] = {p: size * random.uniform(*FACTORS) for p, size in sizes.items()}
    case.depends = sorted(OUTSIDE[name])
    return case


def memory(kind, seed):
    """A thrust or drag that depends on the past."""
    case, random = plain(kind, seed), random_of(kind, seed, "sizes")
    name = in_turn(seed, hidden_cases.HISTORY)[0]
    factor = hidden_cases.SIZE_FACTOR
    low, high = -np.log(factor), np.log(factor)
    sizes = hidden_cases.HISTORY[name].items()
    case.effects[name] = {p: float(s * np.exp(random.uniform(low, high))) for p, s in sizes}
    case.allowed = list(hidden_cases.RIGHT.get(name, []))
    case.depends = sorted(MEMORY[name])
    return case


def faults(kind, seed):
    """One effect, and a mocap that fails for a second now and then."""
    case = one(kind, seed)
    case.gaps = True
    return case


# The maker of the crafts of each kind, their default number, and the longest time of flight [s].
KINDS = {
    "one": (one, 200, 180.0),
    "two": (several(2), 100, 300.0),
    "three": (several(3), 50, 300.0),
    "none": (plain, 100, 180.0),
    "outside": (outside, 50, 180.0),
    "memory": (memory, 50, 180.0),
    "faults": (faults, 20, 180.0),
}


def make(kind, seed):
    """The Case of a kind and a seed."""
    return KINDS[kind][0](kind, seed)
