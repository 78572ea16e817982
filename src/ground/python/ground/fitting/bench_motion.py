"""What recorded motion says beside a thrust bench: how the forces agree, mass and moment of inertia.

Motion alone tells forces relative to the mass only: k/m, and forces times their levers relative to I_z. With
forces from a bench, m and I_z follow. They are fitted together with the damping by the likelihood of the
poses under a model with a random disturbance: what a controller does against disturbances would bias a fit
without. A delay or a lag of the thrusters is part of it where the likelihood asks for one.
"""

import math
from dataclasses import dataclass
from typing import Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

from ground import _core
from ground.analysis.distributions import LEVEL
from ground.analysis.likelihood import Likelihood
from ground.analysis.window_error import free_parameters
from ground.data.measured import Part, measured
from ground.data.read import Recordings
from ground.effect_library import candidates
from ground.fitting import result as fitting
from ground.models import Model
from ground.support.annotations import Array
from ground.support.errors import Diverged
from ground.support.progress import Work
from ground.support.quantities import quantity, with_interval

MOVING, STAGE = ("input_delay", "motor_lag"), "fitting mass and inertia to motion"
STARTS = (0.02, 0.05, 0.1, 0.2)  # initial values of a delay or a lag [s]
UNSURE = 1.0  # relative half-width of an interval from which a number is not identifiable


class WithInterval(NamedTuple):
    """A positive value with its 95% interval."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, *others: "WithInterval") -> "WithInterval":
        """A value with the interval of several independent uncertainties of its logarithm."""
        below = math.hypot(*(math.log(one.value / one.low) if one.low > 0 else math.inf for one in others))
        above = math.hypot(*(math.log(one.high / one.value) for one in others))
        return cls(value, value * math.exp(-below), value * math.exp(above))

    def plain(self, **more: object) -> Dict[str, object]:
        """Plain values, and more before them."""
        return {**more, "value": self.value, "ci95": [self.low, self.high]}


@dataclass(frozen=True)
class MassByMotion:
    """What motion says with the bench's forces."""

    k: WithInterval  #: with the model's mass [N]
    m: WithInterval  #: with the bench's k [kg]
    I_z: WithInterval  #: with the bench's k [kg m^2]
    given: Tuple[float, float]  #: m and I_z of the model
    bench: WithInterval  #: k of the bench [N]
    delay: Optional[Tuple[str, WithInterval]]  #: effect that was added, and its time [s]
    pulse: float  #: mean time for which a command stays [s]
    converged: bool
    scale: float = 1.0  #: from the bench's k to the model's

    @property
    def ratio(self) -> WithInterval:
        """Thrust in motion over that on the bench, with both uncertainties."""
        return WithInterval.of(self.k.value / self.bench.value, self.k, self.bench)

    def to_dict(self) -> Dict[str, object]:
        """Plain values."""
        found: Dict[str, object] = {
            "parameters": {"k": self.k.plain(), "m": self.m.plain(), "I_z": self.I_z.plain()},
            "ratio": self.ratio.plain(),
            "given": {"m": self.given[0], "I_z": self.given[1]},
            "converged": self.converged,
        }
        if self.delay:
            found["delay"] = self.delay[1].plain(effect=self.delay[0])
        return found

    @property
    def mass(self) -> str:
        """The mass in words."""
        return "%s; the model has %.4g kg" % (with_interval(*self.m, "kg"), self.given[0])

    def lines(self) -> Iterator[str]:
        """It in words."""
        yield (
            "what the forces do at once (a random disturbance explains the rest): %s with m = %.4g kg; the "
            "ratio to the bench's is %s"
            % (with_interval(*self.k, "N"), self.given[0], with_interval(*self.ratio, ""))
        )
        yield "mass from motion with the bench's forces: m = %s" % self.mass
        yield "moment of inertia likewise: I_z = %s; the model has %.3g kg m^2" % (
            with_interval(*self.I_z, "kg m^2"),
            self.given[1],
        )
        if self.delay:
            effect, times = self.delay
            yield "the craft follows its commands late: %s %s (commands stay for %s on average)" % (
                effect,
                with_interval(*times, "s"),
                quantity(self.pulse, "s", 2),
            )
        else:
            yield "no sign of a delay or a lag of the thrusters"
        if not self.converged:
            yield "this fit has not converged: do not rely on it"

    def verdict(self, windows: fitting.Fit) -> str:
        """Whether bench and motion agree, and what follows. windows: a fit of k over windows."""
        value, low, high = self.ratio
        if not (math.isfinite(low) and high - low < 2 * UNSURE * value):
            return "the mass is not identifiable from this motion: record runs with more pushes"
        if not low <= 1 <= high:
            return (
                "bench and motion intervals do not overlap: in motion the thrusters push %s, or the mass "
                "is %s. Losses in motion, a low supply, a wrong mass or a wrong lever make the two differ. "
                "Controllers and diagnosis need values in motion: fit with k free"
                % ("less" if value < 1 else "more", quantity(self.m.value, "kg", 3))
            )
        k = windows.parameters["k"]
        if k.ci95[0] <= self.bench.high * self.scale and k.ci95[1] >= self.bench.low * self.scale:
            return "the intervals of bench and motion overlap"
        return (
            "immediate forces equal the bench's, but over windows the craft moves as if they were "
            "%.2f times as large: an effect is missing, and diagnose looks for it. Until then take k from a "
            "fit" % (k.value / (self.bench.value * self.scale))
        )


def over_windows(fit: fitting.Fit, bench: float, at: str) -> str:
    """What a fit with k free says of the bench's k in the model [N]."""
    k = fit.parameters["k"]
    text = "motion over windows gives %s %s, %.2f times the bench's"
    return text % (with_interval(k.value, *k.ci95, "N"), at, k.value / bench)


def motion(model: Model, bench: WithInterval, recordings: Recordings, part: Part, work: Work) -> MassByMotion:
    """The MassByMotion of recordings. model: with the bench's thrust; bench: its k. GroundError where
    the recordings cannot be used."""
    seen = measured(recordings, model, part, work)
    likelihood = Likelihood(seen.data, model.core)
    starts = list(_starts(model.core))
    with work.stage(STAGE, 1 + len(starts)):
        plain = best = likelihood.fit(model.core, _free(model.core))
        work.step()
        effect = ""
        for name, start in starts:
            try:
                found = likelihood.fit(start, _free(start), plain)
            except Diverged:  # it cannot be simulated
                found = plain
            work.step()
            needed = plain.log_posterior + stats.chi2.isf(LEVEL / len(MOVING), 1) / 2
            if found.log_posterior > max(needed, best.log_posterior):
                best, effect = found, name
    known = {p["name"]: WithInterval(p["value"], *p["ci95"]) for p in likelihood.intervals(best)}
    m, inertia, given = known["m"], known["I_z"], model.core.value("m")
    time = next((one for name, one in known.items() if effect and name.split(".")[0] == effect), None)
    times = [recording.control_times for recording in seen.recordings]
    in_k = (bench.value * given / mass for mass in (m.value, m.high, max(m.low, 1e-9 * m.value)))
    return MassByMotion(
        WithInterval(*in_k),
        WithInterval.of(m.value, m, bench),
        WithInterval.of(inertia.value, inertia, bench),
        (given, model.core.value("I_z")),
        bench,
        (effect, time) if time else None,
        _held(times, [recording.thrust for recording in seen.recordings]),
        best.converged,
        model.core.value("k") / bench.value,
    )


def _free(model: _core.Model) -> List[str]:
    """The nominal parameters with m instead of k, and the effects' parameters."""
    return ["m", *(name for name in free_parameters(model) if name != "k")]


def _starts(model: _core.Model) -> Iterator[Tuple[str, _core.Model]]:
    """Effects that a delay of the thrusters may be, and models that have them."""
    for name in MOVING:
        if set(MOVING) & set(model.effects):
            return
        for time in STARTS:
            start = candidates.of_library(name).neutral(model)
            (parameter,) = candidates.parameters_of(start, name)
            start.set_value(parameter.name, time)
            yield name, start


def _held(times: Sequence[Array], commands: Sequence[Array]) -> float:
    """Mean time for which a thruster stays on [s]; nan where none is ever off and on."""
    total = count = 0.0
    for stamps, rows in zip(times, commands):
        on = np.asarray(rows) > 0.5
        total += float((np.diff(stamps)[:, None] * on[:-1]).sum())
        count += float((on[1:] & ~on[:-1]).sum())
    return total / count if count else math.nan
