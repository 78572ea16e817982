"""What recorded motion says beside a thrust bench: how the forces agree, mass and moment of inertia.

Motion alone tells forces relative to the mass only: k/m, and forces times their levers relative to I_z. With
forces from a bench, m and I_z follow. They are fitted together with the damping by the likelihood of the
poses under a model with a random disturbance: what a controller does against disturbances would bias a fit
without. A delay or a lag of the thrusters is part of it where the likelihood asks for one.
"""

import math
from dataclasses import dataclass
from typing import Iterator, List, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

from ground import _core
from ground.analysis.likelihood import Likelihood
from ground.analysis.window_error import free_parameters
from ground.data.measured import Part, measured
from ground.data.read import Recordings
from ground.effect_library import candidates
from ground.fitting import result as fitting
from ground.models import Model
from ground.support.annotations import Document
from ground.support.errors import Diverged
from ground.support.progress import Work
from ground.support.quantities import quantity, with_interval

MOVING, STAGE = ("input_delay", "motor_lag"), "fitting mass and inertia to motion"
LEVEL = 0.01  # probability of adding a delay that is not there
STARTS = (0.02, 0.05, 0.1, 0.2)  # initial values of a delay or a lag [s]
UNSURE = 1.0  # relative half-width of an interval from which a number is not identifiable


@dataclass(frozen=True)
class MassByMotion:
    """What motion says with the bench's forces."""

    k: Tuple[float, float, float]  #: value and 95% interval, with the model's mass [N]
    m: Tuple[float, float, float]  #: with the bench's k [kg]
    I_z: Tuple[float, float, float]  #: with the bench's k [kg m^2]
    given: Tuple[float, float]  #: m and I_z of the model
    bench: Tuple[float, float, float]  #: k of the bench [N]
    delay: Optional[
        Tuple[str, Tuple[float, float, float]]
    ]  #: effect that was added, its time and 95% interval [s]
    pulse: float  #: mean time for which a command stays [s]
    converged: bool
    scale: float = 1.0  #: from the bench's k to the model's

    @property
    def ratio(self) -> Tuple[float, float, float]:
        """Thrust in motion over that on the bench, and its 95% interval with both uncertainties."""
        value = self.k[0] / self.bench[0]
        return _times(value, _relative(self.k), _relative(self.bench))

    def to_dict(self) -> Document:
        """Plain values."""
        found: Document = {
            "parameters": {n: _plain(getattr(self, n)) for n in ("k", "m", "I_z")},
            "ratio": _plain(self.ratio),
            "given": {"m": self.given[0], "I_z": self.given[1]},
            "converged": self.converged,
        }
        if self.delay:
            found["delay"] = {"effect": self.delay[0], **_plain(self.delay[1])}
        return found

    @property
    def mass(self) -> str:
        """The mass in words."""
        return "%.3g kg [%.3g, %.3g]; the model has %.4g kg" % (*self.m, self.given[0])

    def lines(self) -> Iterator[str]:
        """It in words."""
        yield (
            "what the forces do at once (a random disturbance explains the rest): %.3g N [%.3g, %.3g] with "
            % self.k
            + ("m = %.4g kg, %.2f times the bench's [%.2f, %.2f]" % (self.given[0], *self.ratio))
        )
        yield "mass from motion with the bench's forces: m = %s" % self.mass
        yield "moment of inertia likewise: I_z = %.3g kg m^2 [%.3g, %.3g]; the model has %.3g kg m^2" % (
            *self.I_z,
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
                "the intervals of bench and motion are apart: in motion the thrusters push %s, or the mass "
                "is %s. Losses in motion, a low supply, a wrong mass or a wrong lever make the two differ. "
                "Controllers and diagnosis need what motion tells: fit with k free"
                % ("less" if value < 1 else "more", quantity(self.m[0], "kg", 3))
            )
        k = windows.parameters["k"]
        if k.ci95 and k.ci95[0] <= self.bench[2] * self.scale and k.ci95[1] >= self.bench[1] * self.scale:
            return "the intervals of bench and motion meet"
        return (
            "the forces equal the bench's at once, but over windows the craft moves as if they were "
            "%.2f times as large: an effect is missing, and diagnose looks for it. Until then take k from a "
            "fit" % (k.value / (self.bench[0] * self.scale))
        )


def over_windows(fit: fitting.Fit, bench: float, at: str) -> str:
    """What a fit with k free says of the bench's k in the model [N]."""
    k = fit.parameters["k"]
    low, high = k.ci95 or (math.nan, math.nan)
    text = "motion over windows tells %.4g N %s [%.4g, %.4g], %.2f times the bench's"
    return text % (k.value, at, low, high, k.value / bench)


def motion(
    model: Model, bench: Tuple[float, float, float], recordings: Recordings, part: Part, work: Work
) -> MassByMotion:
    """The MassByMotion of recordings. model: with the bench's thrust; bench: its k and the 95% interval.
    GroundError where the recordings cannot be used."""
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
    described = {p["name"]: p for p in likelihood.intervals(best)}
    m, inertia = (_interval(described[name]) for name in ("m", "I_z"))
    given, own = model.core.value("m"), _relative(bench)
    time = next((p for name, p in described.items() if effect and name.split(".")[0] == effect), None)
    return MassByMotion(
        (bench[0] * given / m[0], bench[0] * given / m[2], bench[0] * given / max(m[1], 1e-9 * m[0])),
        _times(m[0], _relative(m), own),
        _times(inertia[0], _relative(inertia), own),
        (given, model.core.value("I_z")),
        bench,
        (effect, _interval(time)) if time else None,
        _held(
            [recording.control_times for recording in seen.recordings], [r.thrust for r in seen.recordings]
        ),
        best.converged,
        model.core.value("k") / bench[0],
    )


def _free(model: _core.Model) -> List[str]:
    """The nominal parameters with m in place of k, and the effects' parameters."""
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


def _interval(parameter: Document) -> Tuple[float, float, float]:
    low, high = parameter["ci95"] or (math.nan, math.nan)
    return float(parameter["value"]), float(low), float(high)


def _relative(one: Tuple[float, float, float]) -> Tuple[float, float]:
    """Distances of the logarithms of an interval's ends and of the value, which is positive."""
    value, low, high = one
    return math.log(value / low) if low > 0 else math.inf, math.log(high / value)


def _times(value: float, *relative: Tuple[float, float]) -> Tuple[float, float, float]:
    """A positive value with the interval of several independent uncertainties of its logarithm."""
    below, above = (math.sqrt(sum(end[i] ** 2 for end in relative)) for i in (0, 1))
    return value, value * math.exp(-below), value * math.exp(above)


def _plain(one: Tuple[float, float, float]) -> Document:
    return {"value": one[0], "ci95": [one[1], one[2]]}


def _held(times: Sequence[np.ndarray], commands: Sequence[np.ndarray]) -> float:  # type: ignore[type-arg]
    """Mean time for which a thruster stays on [s]; nan where none is ever off and on."""
    total = count = 0.0
    for stamps, rows in zip(times, commands):
        on = np.asarray(rows) > 0.5
        total += float((np.diff(stamps)[:, None] * on[:-1]).sum())
        count += float((on[1:] & ~on[:-1]).sum())
    return total / count if count else math.nan
