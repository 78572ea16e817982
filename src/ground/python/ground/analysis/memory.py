"""Whether the motion depends on the past: effects with states, added to a grown model.

Each kind of memory is an effect as model files list it, with a state that forgets with a time
constant. Score tests of all kinds and times choose the one to refit. It has to raise the
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
class Kind:
    """A way in which the past may act. `c` is its size, `tau` its time constant."""

    name: str
    means: str  # the dependence in words, with %s for the time
    unit: str  # unit of c
    scale: float  # typical size of c
    times: Tuple[float, ...]  # time constants that are tried [s]
    states: Dict[str, str]
    expression: Dict[str, str]

    def entry(self, time: float, size: float = 0.0) -> Document:
        """The effect as model files list it, its tau at a time [s]; neutral at c = 0."""
        return {
            "name": self.name,
            "states": dict(self.states),
            "expression": dict(self.expression),
            "parameters": {
                "c": dict(self._size(), value=size),
                "tau": {"value": time, "unit": "s", "neutral": time, "lower": 0.02, "upper": 100.0},
            },
        }

    def at(self, time: float, model: _core.Model) -> candidates.Candidate:
        """The Candidate for a model with a fixed time constant, for score tests of several times."""
        states = {s: f.replace("tau", repr(time)) for s, f in self.states.items()}
        entry = dict(self.entry(time), states=states, parameters={"c": self._size()})
        entry["name"] += "_%d" % round(1e3 * time)
        return candidates.from_entry(entry, self.name, model)

    def _size(self) -> Document:
        size = {"value": 0.0, "unit": self.unit, "neutral": 0.0, "scale": self.scale}
        return dict(size, lower=-1e3, upper=1e3)


BRIEF, LONG = (0.08,), (0.3, 1.5)


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
    drawn = {"p": "(%s - p)/tau" % total}
    return (
        Kind("thrust_droop", "thrust falls or grows while a thruster is driven, within %s", "N", 0.01,
             LONG, own, each_thrust("-c*past_N*u_N")),
        Kind("battery_droop", "thrust depends on what all thrusters drew in the last %s", "N", 0.01,
             LONG, drawn, each_thrust("-c*p*u_N")),
        Kind("warm_up", "thrust depends on how long the thrusters were driven since the start, over %s "
             "of full thrust", "N", 0.01, (3.0,), {"p": total + "/tau"},
             each_thrust("-c*exp(-p)*u_N")),
        Kind("spin_up", "thrust rises and falls at different pace, by %s", "N", 0.01,
             BRIEF, own, each_thrust("-c*abs(u_N - past_N)")),
        Kind("skirt_pressure", "damping depends on the speed of the last %s", "N s^3/m^3", 0.01,
             LONG, {"p": "(u*u + v*v - p)/tau"}, {"X": "-c*p*u", "Y": "-c*p*v"}),
        Kind("skirt_filling", "damping depends on the lift of the last %s", "N s/m", 0.01,
             LONG, {"p": "(lift - p)/tau"}, {"X": "-c*(lift - p)*u", "Y": "-c*(lift - p)*v"}),
        Kind("wake", "a force follows the velocity of the last %s", "N s/m", 0.01,
             LONG, {"p": "(u - p)/tau", "q": "(v - q)/tau"}, {"X": "-c*(p - u)", "Y": "-c*(q - v)"}),
    )  # fmt: skip


@can_be_kept
@dataclass(frozen=True)
class Memory:
    """The likeliest kind of memory that holds."""

    kind: Kind
    p_value: float  # of the best kind and time, corrected for their number
    fit: Fit  # of the model with it

    @property
    def time(self) -> float:
        """Its time constant [s]."""
        return self.fit.model.value(self.kind.name + ".tau")

    @property
    def means(self) -> str:
        """The dependence in words, with the time."""
        return self.kind.means % ("%.2g s" % self.time)

    @property
    def entry(self) -> Document:
        """The effect as model files list it, its parameters fitted."""
        return self.kind.entry(self.time, self.fit.model.value(self.kind.name + ".c"))


def find(likelihood: Likelihood, fit: Fit) -> Optional[Memory]:
    """The likeliest Memory to add to a likelihood.Fit; None without a significant one."""
    kinds = [kind for kind in kinds_of(fit.model) if kind.name not in fit.model.effects]
    tried = {
        c.name: (kind, time, c)
        for kind in kinds
        for time in kind.times
        for c in [kind.at(time, fit.model)]
    }
    tests = ScoreTests(likelihood, fit, [c for _, _, c in tried.values()])
    gains = {name: tests.test((name,))[0] for name in tried}
    best = max(gains, key=gains.__getitem__)
    chance = min(1.0, len(tried) * float(stats.chi2.sf(gains[best], 1)))
    if chance > LEVEL or gains[best] < MIN_RATIO:
        return None
    kind, time, _ = tried[best]
    _, step = tests.test((best,))
    timed = _fitted(likelihood, fit, kind, time, step[best + ".c"])
    if timed is None or 2 * (timed.log_posterior - fit.log_posterior) < MIN_RATIO:
        return None
    return Memory(kind, chance, timed)


def _fitted(
    likelihood: Likelihood, fit: Fit, kind: Kind, time: float, size: float
) -> Optional[Fit]:
    """The Fit with a kind of memory, first its size and then its time as well; None where that
    fails."""
    entry = kind.entry(time)
    start = candidates.from_entry(entry, kind.name, fit.model).neutral(fit.model)
    start.set_value(kind.name + ".c", size)
    try:
        sized = likelihood.fit(start, fit.free + (kind.name + ".c",), near=fit)
        return likelihood.fit(sized.model, sized.free + (kind.name + ".tau",), near=sized)
    except GroundError:
        return None
