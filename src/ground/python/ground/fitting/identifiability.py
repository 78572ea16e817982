"""Parameters that a fit does not identify, in words."""

from dataclasses import dataclass
from typing import Callable, Dict, Iterator, List, Sequence, Tuple, TypedDict

import numpy as np

from ground import _core
from ground.analysis import likelihood, window_error, windows
from ground.models import Parameter, parameters_by_name
from ground.reading import payloads
from ground.support.annotations import Array
from ground.support.errors import Diverged

WELL_KNOWN = 0.03  # relative deviation below which a parameter is well known
MAX_COMBINED = 0.5  # largest deviation of a combination to be named, relative to its better part

PROBE, DRAWS = 1.25, 2  # artificial recordings: factor on the parameters, number of pairs
KEPT = ("I_z", "k", "N_r", "Y_v", "X_u")  # in this order: what a user can weigh comes first


@dataclass(frozen=True)
class WindowEstimates:
    """What a fit to windows found."""

    model: _core.Model
    parameters: Dict[str, Parameter]  #: by name
    correlation: Array  #: (n, n) of the estimates
    freedom: float  #: degrees of freedom of Student's t of the intervals

    @classmethod
    def of(cls, result: window_error.FitResult) -> "WindowEstimates":
        """Of what the core's fit returns."""
        correlation = np.array(result.correlation)
        return cls(result.model, parameters_by_name(result.parameters), correlation, result.freedom)


class WeakDirection(TypedDict):
    """Two parameters of which only the ratio or product is identifiable."""

    parameters: List[str]
    known_as: str  #: "a/b" or "a*b"
    deviation: float  #: relative standard deviation of that
    deviations: List[float]  #: ... of the two
    strength: float  #: deviation of the worse one over the combination's


Fitted = Callable[[Sequence[_core.RunData], _core.Model, Sequence[str]], WindowEstimates]  # runs, start, kept


def kept(
    runs: Sequence[_core.RunData], start: _core.Model, free: Sequence[str], fit: Fitted
) -> Tuple[WindowEstimates, List[str], List[str]]:
    """What a fit finds, which free parameters (of KEPT) keep their start, and which are not identifiable.

    These are: what the fit says; what has its start in an interval that also holds no effect of the
    thrusters, or a damping that stops the craft within its time scale; what the fit misses half of a
    change of. One after the other is kept, because others may follow from it.
    """
    keep: List[str] = []
    unknown: List[str] = []
    while True:
        found = fit(runs, start, keep)
        rest = [name for name in free if name not in keep]
        missed = _missed(runs, found.model, rest, keep, fit)
        doubtful = [
            name
            for name, p in found.parameters.items()
            if name in rest
            if not p.identified or missed[name] > 0.5 or _open_ended(p, found.model, start)
        ]
        unknown += [name for name in doubtful if name not in unknown]
        if not doubtful:
            return found, keep, unknown
        keep.append(min(doubtful, key=KEPT.index))


def _open_ended(p: Parameter, model: _core.Model, start: _core.Model) -> bool:
    (low, high), limit = p.ci95, p.value + _stopping(p.name, model)
    wide = low <= 0 or np.isinf(high) if p.name in ("I_z", "k") else high > limit
    return bool(wide and low <= start.value(p.name) <= high)


def _stopping(name: str, model: _core.Model) -> float:
    """Damping that stops a craft within its time scale; 0 for a parameter that is no damping."""
    inert = {"X_u": "m", "Y_v": "m", "N_r": "I_z"}.get(name)
    return model.value(inert) / _core.time_scale(model) if inert else 0.0


def _missed(
    runs: Sequence[_core.RunData], model: _core.Model, free: Sequence[str], keep: Sequence[str], fit: Fitted
) -> Dict[str, float]:
    """Share of a change of each parameter that fits miss at most: recordings of the same commands and noise
    are made with a model and a changed one. All change by a factor, because dull motion gives ratios."""
    begun, cut = [np.array(run.nu) for run in runs], windows.cut(runs)
    for window, nu in zip(cut, likelihood.call(windows.problem(runs, cut).simulate, model)["nu"]):
        begun[window.run][window.first] = nu[0]  # the fit knows it better than the smoother
    runs = [run.replaced(nu=nu) for run, nu in zip(runs, begun)]
    missed, changed = dict.fromkeys(free, 0.0), model.copy()
    for name in free:
        value = model.value(name)
        changed.set_value(name, value + (PROBE - 1) * max(value, _stopping(name, model)))
    for draw in range(DRAWS):
        pair = []
        for true in (model, changed):
            seeds = [np.random.default_rng((draw, i)) for i in range(len(runs))]
            try:
                made = [window_error.recorded(run, true, seed) for run, seed in zip(runs, seeds)]
                pair.append(fit(made, model, keep).model)
            except Diverged:
                return missed  # the model cannot be simulated along the runs
        for name in free:
            off = pair[1].value(name) - pair[0].value(name)
            missed[name] = max(missed[name], abs(off / (changed.value(name) - model.value(name)) - 1))
    return missed


def with_mass(free: Sequence[str], runs: Sequence[_core.RunData]) -> List[str]:
    """The free parameters and the mass m, where the payloads of runs (_core.RunData) differ: then motion
    identifies m, I_z and k themselves, else only their ratios."""
    joint = payloads.differ(runs) and {"k", "I_z"} <= set(free) and "m" not in free
    return ["m"] * joint + list(free)


def without_mass(free: Sequence[str], runs: Sequence[_core.RunData]) -> List[str]:
    """The free parameters that runs of the same payload identify: not m beside I_z and k."""
    joint = {"k", "I_z"} <= set(free) and not payloads.differ(runs)
    return [name for name in free if not (joint and name == "m")]


def of_payloads(runs: Sequence[_core.RunData], free: Sequence[str]) -> Iterator[str]:
    """Sentences on what the craft carried, and what follows."""
    carried = ["%s: %s" % (run.name, payloads.in_words(run.payload)) for run in runs]
    if not all(run.payload.empty() for run in runs):
        yield "payloads: " + "; ".join(carried)
    if payloads.differ(runs) and {"m", "I_z", "k"} <= set(free):
        yield (
            "the runs differ in mass by known payloads, so m, I_z and k themselves are identifiable, not "
            "only ratios"
        )


def weak_directions(fit: WindowEstimates) -> List[WeakDirection]:
    """Pairs of parameters of which only the ratio or product is identifiable, strongest first. Linear in the
    logarithms of the parameters, by the covariance that the fit gives."""
    rows = [
        (i, p, p.deviation / abs(p.value))
        for i, p in enumerate(fit.parameters.values())
        if p.identified and p.value != 0 and np.isfinite(p.deviation)
    ]
    found = []
    for at, (i, first, a) in enumerate(rows):
        for j, second, b in rows[at + 1 :]:
            together = np.sign(first.value * second.value) * fit.correlation[i][j]
            known = np.sqrt(max(a * a + b * b - 2 * abs(together) * a * b, 0.0))
            worse, better = max(a, b), min(a, b)
            if better < WELL_KNOWN or known > MAX_COMBINED * better:
                continue
            names = [first.name, second.name]
            known_as = ("/" if together > 0 else "*").join(names)
            strength = float(worse / max(known, 1e-9))
            found.append(
                WeakDirection(
                    parameters=names,
                    known_as=known_as,
                    deviation=float(known),
                    deviations=[float(a), float(b)],
                    strength=strength,
                )
            )
    return sorted(found, key=lambda weak: -weak["strength"])


def sentences(fit: WindowEstimates) -> Iterator[str]:
    """Sentences for the user about parameters that are not identifiable."""
    for p in fit.parameters.values():
        if p.identified and p.at_bound:
            yield "%s is at its bound; the data prefer a value beyond it" % p.name
    for weak in weak_directions(fit):
        (first, second), (a, b) = weak["parameters"], weak["deviations"]
        yield (
            "%s and %s are only known as %s: this to ±%.2g%%, %s to ±%.2g%% and %s to ±%.2g%% (one "
            "standard deviation); fix one of them, or record inputs that distinguish them"
            % (first, second, weak["known_as"], 100 * weak["deviation"], first, 100 * a, second, 100 * b)
        )
