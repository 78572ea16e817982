"""Whether the motion depends on the past: effects with states, added to a grown model.

Each kind of memory is an effect as model files list it, with states that forget within a time or
follow with play. Score tests of all kinds, at some values of their constants, choose the one to
refit. It has to raise the
likelihood significantly, corrected for the number of tests, and the held-out likelihood, too.
"""

import re
from dataclasses import dataclass
from typing import Callable, Dict, Optional, Sequence, Tuple

from ground import _core
from ground.analysis import candidates, score_tests
from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import Fit, Likelihood
from ground.annotations import Document
from ground.errors import GroundError

# Least log-likelihood ratio. By chance alone, one so large has a probability of 1e-4 where there is no
# memory; a slighter one may come from other errors of the model.
MIN_RATIO = 20.0


def _value_of(values: Dict[str, str]) -> Callable[["re.Match[str]"], str]:
    return lambda found: values[found.group()]


@dataclass(frozen=True)
class Constant:
    """A number in the formulas of a Kind, and the range of its value."""

    name: str  # in formulas
    unit: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Kind:
    """A way in which the past may act. `c` is its size."""

    name: str
    means: str  # the dependence in words, with %s for each constant
    unit: str  # unit of c
    scale: float  # typical size of c
    constants: Tuple[Constant, ...]  # in its formulas
    tried: Tuple[Tuple[float, ...], ...]  # their values that are tried
    states: Dict[str, str]
    expression: Dict[str, str]

    def entry(self, at: Sequence[float], size: float = 0.0) -> Document:
        """The effect as model files list it, its constants at values; neutral at c = 0."""
        parameters = {"c": dict(self._size(), value=size)}
        for constant, value in zip(self.constants, at):
            limits = {"lower": constant.lower, "upper": constant.upper}
            parameters[constant.name] = dict(limits, value=value, unit=constant.unit, neutral=value)
        return {
            "name": self.name,
            "states": dict(self.states),
            "expression": dict(self.expression),
            "parameters": parameters,
        }

    def at(self, values: Sequence[float], model: _core.Model) -> candidates.Candidate:
        """The Candidate for a model with fixed constants, for score tests at several values."""
        fixed = {constant.name: repr(value) for constant, value in zip(self.constants, values)}

        def at_values(formulas: Dict[str, str]) -> Dict[str, str]:
            names = r"\b(?:%s)\b" % "|".join(fixed)
            return {what: re.sub(names, _value_of(fixed), f) for what, f in formulas.items()}

        entry = {
            "name": self.name + "".join("_%d" % round(1e3 * value) for value in values),
            "states": at_values(self.states),
            "expression": at_values(self.expression),
            "parameters": {"c": self._size()},
        }
        return candidates.from_entry(entry, self.name, model)

    def _size(self) -> Document:
        size = {"value": 0.0, "unit": self.unit, "neutral": 0.0, "scale": self.scale}
        return dict(size, lower=-1e3, upper=1e3)


TIME = (Constant("tau", "s", 0.02, 100.0),)
LONG = ((0.3,), (1.5,))
PACES = (Constant("rise", "s", 0.005, 10.0), Constant("fall", "s", 0.005, 10.0))
UNEQUAL = ((0.06, 0.02), (0.02, 0.06))
PLAY = (Constant("half", "-", 0.005, 0.5),)  # half of the width of a play, in inputs
WIDTHS = ((0.04,), (0.1,))
# Time constant with which a play is taken up, as short as steps of 10 ms allow [s]
TAKES_UP = 0.005


def kinds_of(model: _core.Model) -> Tuple[Kind, ...]:
    """What depends on the past, for a model's thrusters."""
    names = ["L", "R"] if model.is_pair else [thruster["name"] for thruster in model.thrusters]
    # The length of formulas is limited: numbers stand for the names of other thrusters than L and R.
    short = dict(zip(names, names if model.is_pair else map(str, range(1, len(names) + 1))))
    total = "(%s)" % " + ".join("u_" + short[name] for name in names)

    def each_thrust(formula: str) -> Dict[str, str]:
        """A formula for the thrust of each thruster, which N stands for."""
        return {"thrust_" + name: formula.replace("N", short[name]) for name in names}

    def each_past(rate: str) -> Dict[str, str]:
        """The state past_N of each thruster, by the formula of its derivative."""
        return {"past_" + s: rate.replace("N", s) for s in short.values()}

    own = each_past("(u_N - past_N)/tau")
    paced = each_past("(u_N - past_N)/(u_N > past_N ? rise : fall)")
    played = "min(max(past_N, u_N - half), u_N + half)"
    held = each_past("(%s - past_N)/%g" % (played, TAKES_UP))
    drawn = {"p": "(%s - p)/tau" % total}
    return (
        Kind("thrust_droop", "thrust falls or grows while a thruster is driven, within %s", "N", 0.01,
             TIME, LONG, own, each_thrust("-c*past_N*u_N")),
        Kind("battery_droop", "thrust depends on what all thrusters drew in the last %s", "N", 0.01,
             TIME, LONG, drawn, each_thrust("-c*p*u_N")),
        Kind("warm_up", "thrust depends on how long the thrusters were driven since the start, over %s "
             "of full thrust", "N", 0.01, TIME, ((3.0,),), {"p": total + "/tau"},
             each_thrust("-c*exp(-p)*u_N")),
        Kind("spin_up", "thrust rises within %s and falls within %s", "N", 0.01, PACES, UNEQUAL,
             paced, each_thrust("-c*(u_N - past_N)")),
        Kind("thrust_backlash", "thrust follows its command with play: by %s less after a rise, more "
             "after a fall", "N", 0.01, PLAY, WIDTHS, held, each_thrust("-c*(u_N - %s)" % played)),
        Kind("skirt_pressure", "damping depends on the speed of the last %s", "N s^3/m^3", 0.01,
             TIME, LONG, {"p": "(u*u + v*v - p)/tau"}, {"X": "-c*p*u", "Y": "-c*p*v"}),
        Kind("skirt_filling", "damping depends on the lift of the last %s", "N s/m", 0.01,
             TIME, LONG, {"p": "(lift - p)/tau"}, {"X": "-c*(lift - p)*u", "Y": "-c*(lift - p)*v"}),
        Kind("wake", "a force follows the velocity of the last %s", "N s/m", 0.01,
             TIME, LONG, {"p": "(u - p)/tau", "q": "(v - q)/tau"},
             {"X": "-c*(p - u)", "Y": "-c*(q - v)"}),
    )  # fmt: skip


@dataclass(frozen=True)
class Memory:
    """The likeliest kind of memory that holds."""

    kind: Kind
    p_value: float  # of the best kind and constants, corrected for their number
    fit: Fit  # of the model with it

    @property
    def constants(self) -> Tuple[float, ...]:
        """The fitted values of the kind's constants, in their units."""
        names = ["%s.%s" % (self.kind.name, constant.name) for constant in self.kind.constants]
        return tuple(self.fit.model.value(name) for name in names)

    @property
    def means(self) -> str:
        """The dependence in words, with the constants."""
        units = ["of input" if c.unit == "-" else c.unit for c in self.kind.constants]
        return self.kind.means % tuple("%.2g %s" % found for found in zip(self.constants, units))

    @property
    def entry(self) -> Document:
        """The effect as model files list it, its parameters fitted."""
        return self.kind.entry(self.constants, self.fit.model.value(self.kind.name + ".c"))


def find(likelihood: Likelihood, fit: Fit) -> Optional[Memory]:
    """The likeliest Memory to add to a likelihood.Fit; None without a significant one."""
    kinds = [kind for kind in kinds_of(fit.model) if kind.name not in fit.model.effects]
    tried = {
        c.name: (kind, values, c)
        for kind in kinds
        for values in kind.tried
        for c in [kind.at(values, fit.model)]
    }
    parts = score_tests.in_parts(likelihood, fit, [c for _, _, c in tried.values()])
    tests = {name: part.test((name,)) for part in parts for name in part.columns}
    gains = {name: gain for name, (gain, _) in tests.items()}
    best = max(gains, key=gains.__getitem__)
    if gains[best] < MIN_RATIO:
        return None
    chance = min(1.0, len(tried) * chi_squared_above(gains[best], 1))
    kind, values, _ = tried[best]
    timed = _fitted(likelihood, fit, kind, values, tests[best][1][best + ".c"])
    if timed is None or 2 * (timed.log_posterior - fit.log_posterior) < MIN_RATIO:
        return None
    return Memory(kind, chance, timed)


def _fitted(
    likelihood: Likelihood, fit: Fit, kind: Kind, at: Sequence[float], size: float
) -> Optional[Fit]:
    """The Fit with a kind of memory, first its size and then its constants as well, from given ones
    on; None where that fails."""
    entry = kind.entry(at)
    start = candidates.from_entry(entry, kind.name, fit.model).neutral(fit.model)
    start.set_value(kind.name + ".c", size)
    try:
        sized = likelihood.fit(start, fit.free + (kind.name + ".c",), near=fit)
        constants = tuple("%s.%s" % (kind.name, constant.name) for constant in kind.constants)
        return likelihood.fit(sized.model, sized.free + constants, near=sized)
    except GroundError:
        return None
