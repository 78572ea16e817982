"""Whether the motion depends on the past: effects with states, added to a grown model.

Each kind of memory is an effect as model files list it, with states that forget within a time, or
follow with play of a width. Score tests of all kinds and constants choose the one to refit. It has to raise the
likelihood significantly, corrected for the number of tests, and the held-out likelihood, too.
"""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple

from scipy import stats

from ground import _core
from ground.analysis import candidates
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.score_tests import ScoreTests
from ground.analysis.unfinished import can_be_kept
from ground.annotations import Document
from ground.errors import GroundError

LEVEL = 0.001  # chance of finding memory where there is none
MIN_RATIO = 20.0  # least log-likelihood ratio; a slight one may come from other errors of the model


@can_be_kept
@dataclass(frozen=True)
class Constant:
    """What a Kind's states depend on, and the range of its value."""

    name: str  # in formulas
    unit: str
    lower: float
    upper: float


@can_be_kept
@dataclass(frozen=True)
class Kind:
    """A way in which the past may act. `c` is its size."""

    name: str
    means: str  # the dependence in words, with %s for its constant
    unit: str  # unit of c
    scale: float  # typical size of c
    constant: Constant  # in the formulas of its states
    tried: Tuple[float, ...]  # values of the constant that are tried
    states: Dict[str, str]
    expression: Dict[str, str]

    def entry(self, at: float, size: float = 0.0) -> Document:
        """The effect as model files list it, its constant at a value; neutral at c = 0."""
        constant = self.constant
        limits = {"lower": constant.lower, "upper": constant.upper}
        return {
            "name": self.name,
            "states": dict(self.states),
            "expression": dict(self.expression),
            "parameters": {
                "c": dict(self._size(), value=size),
                constant.name: dict(limits, value=at, unit=constant.unit, neutral=at),
            },
        }

    def at(self, value: float, model: _core.Model) -> candidates.Candidate:
        """The Candidate for a model with a fixed constant, for score tests of several values."""
        states = {s: f.replace(self.constant.name, repr(value)) for s, f in self.states.items()}
        entry = dict(self.entry(value), states=states, parameters={"c": self._size()})
        entry["name"] += "_%d" % round(1e3 * value)
        return candidates.from_entry(entry, self.name, model)

    def _size(self) -> Document:
        size = {"value": 0.0, "unit": self.unit, "neutral": 0.0, "scale": self.scale}
        return dict(size, lower=-1e3, upper=1e3)


TIME = Constant("tau", "s", 0.02, 100.0)
BRIEF, LONG = (0.08,), (0.3, 1.5)
PLAY = Constant("half", "-", 0.005, 0.5)  # half of the width of a play, in inputs
WIDTHS = (0.04, 0.1)
TAKES_UP = 0.01  # time constant with which a play is taken up: short beside a craft's [s]


def kinds_of(model: _core.Model) -> Tuple[Kind, ...]:
    """What depends on the past, for a model's thrusters."""
    names = ["L", "R"] if model.is_pair else [thruster["name"] for thruster in model.thrusters]
    # The length of formulas is limited: numbers stand for the names of other thrusters than L and R.
    short = dict(zip(names, names if model.is_pair else map(str, range(1, len(names) + 1))))
    total = "(%s)" % " + ".join("u_" + short[name] for name in names)

    def each_thrust(formula: str) -> Dict[str, str]:
        """A formula for the thrust of each thruster, which N stands for."""
        return {"thrust_" + name: formula.replace("N", short[name]) for name in names}

    own = {"past_" + s: "(u_%s - past_%s)/tau" % (s, s) for s in short.values()}
    play = "(u_N - past_N - min(max(u_N - past_N, -half), half))/%g" % TAKES_UP
    held = {"past_" + s: play.replace("N", s) for s in short.values()}
    drawn = {"p": "(%s - p)/tau" % total}
    return (
        Kind("thrust_droop", "thrust falls or grows while a thruster is driven, within %s", "N", 0.01,
             TIME, LONG, own, each_thrust("-c*past_N*u_N")),
        Kind("battery_droop", "thrust depends on what all thrusters drew in the last %s", "N", 0.01,
             TIME, LONG, drawn, each_thrust("-c*p*u_N")),
        Kind("warm_up", "thrust depends on how long the thrusters were driven since the start, over %s "
             "of full thrust", "N", 0.01, TIME, (3.0,), {"p": total + "/tau"},
             each_thrust("-c*exp(-p)*u_N")),
        Kind("spin_up", "thrust rises and falls at different pace, by %s", "N", 0.01,
             TIME, BRIEF, own, each_thrust("-c*abs(u_N - past_N)")),
        Kind("thrust_backlash", "thrust follows its command with play: by %s less after a rise, more "
             "after a fall", "N", 0.01, PLAY, WIDTHS, held, each_thrust("-c*(u_N - past_N)")),
        Kind("skirt_pressure", "damping depends on the speed of the last %s", "N s^3/m^3", 0.01,
             TIME, LONG, {"p": "(u*u + v*v - p)/tau"}, {"X": "-c*p*u", "Y": "-c*p*v"}),
        Kind("skirt_filling", "damping depends on the lift of the last %s", "N s/m", 0.01,
             TIME, LONG, {"p": "(lift - p)/tau"}, {"X": "-c*(lift - p)*u", "Y": "-c*(lift - p)*v"}),
        Kind("wake", "a force follows the velocity of the last %s", "N s/m", 0.01,
             TIME, LONG, {"p": "(u - p)/tau", "q": "(v - q)/tau"}, {"X": "-c*(p - u)", "Y": "-c*(q - v)"}),
    )  # fmt: skip


@can_be_kept
@dataclass(frozen=True)
class Memory:
    """The likeliest kind of memory that holds."""

    kind: Kind
    p_value: float  # of the best kind and time, corrected for their number
    fit: Fit  # of the model with it

    @property
    def constant(self) -> float:
        """The value of the kind's constant, in its unit."""
        return self.fit.model.value("%s.%s" % (self.kind.name, self.kind.constant.name))

    @property
    def means(self) -> str:
        """The dependence in words, with the constant."""
        unit = self.kind.constant.unit
        return self.kind.means % ("%.2g %s" % (self.constant, "of input" if unit == "-" else unit))

    @property
    def entry(self) -> Document:
        """The effect as model files list it, its parameters fitted."""
        return self.kind.entry(self.constant, self.fit.model.value(self.kind.name + ".c"))


def find(likelihood: Likelihood, fit: Fit) -> Optional[Memory]:
    """The likeliest Memory to add to a likelihood.Fit; None without a significant one."""
    kinds = [kind for kind in kinds_of(fit.model) if kind.name not in fit.model.effects]
    tried = {
        c.name: (kind, value, c)
        for kind in kinds
        for value in kind.tried
        for c in [kind.at(value, fit.model)]
    }
    tests = ScoreTests(likelihood, fit, [c for _, _, c in tried.values()])
    gains = {name: tests.test((name,))[0] for name in tried}
    best = max(gains, key=gains.__getitem__)
    chance = min(1.0, len(tried) * float(stats.chi2.sf(gains[best], 1)))
    if chance > LEVEL or gains[best] < MIN_RATIO:
        return None
    kind, value, _ = tried[best]
    _, step = tests.test((best,))
    timed = _fitted(likelihood, fit, kind, value, step[best + ".c"])
    if timed is None or 2 * (timed.log_posterior - fit.log_posterior) < MIN_RATIO:
        return None
    return Memory(kind, chance, timed)


def _fitted(
    likelihood: Likelihood, fit: Fit, kind: Kind, at: float, size: float
) -> Optional[Fit]:
    """The Fit with a kind of memory, first its size and then its constant as well, from a value on;
    None where that fails."""
    entry = kind.entry(at)
    start = candidates.from_entry(entry, kind.name, fit.model).neutral(fit.model)
    start.set_value(kind.name + ".c", size)
    try:
        sized = likelihood.fit(start, fit.free + (kind.name + ".c",), near=fit)
        return likelihood.fit(sized.model, sized.free + ("%s.%s" % (kind.name, kind.constant.name),), near=sized)
    except GroundError:
        return None
