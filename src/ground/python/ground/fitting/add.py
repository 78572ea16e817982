"""add: adds a physical effect to a model and refits it, with the error before and after."""

import argparse
import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import distributions, horizon, judge, window_error, windows
from ground.analysis.horizon import ModelsAt, PredictionError
from ground.analysis.window_error import WindowFit
from ground.data import bag_arguments
from ground.data.measured import Measured, held_out, measured
from ground.data.read import Recordings
from ground.effect_library import candidates
from ground.effect_library.effects import Effect, EffectLike
from ground.fitting.result import Change
from ground.models import (
    Estimated,
    Model,
    ModelLike,
    Parameter,
    fitted_model,
    parameter_frame,
    parameters_by_name,
)
from ground.reports import effect_words, words
from ground.support import command_line, records
from ground.support.annotations import Path
from ground.support.headline import Line
from ground.support.progress import Progress, Work
from ground.support.results import Shown

if TYPE_CHECKING:
    import pandas


WORTH = 0.05  # relative fall of the error for which one would add an effect
UNCLEAR = "not clear"
DO = {  # by the answer
    "yes": "use the model with it",
    UNCLEAR: "record more runs, or ask diagnose, which decides by likelihood",
    "no": "keep the model without it",
}
FITTING = "fitting without the effect and with it"  # stage


@dataclass(frozen=True)
class Verdict:
    """Whether an effect helps. The error on held-out data must fall by more than chance explains, and its
    parameters must differ from the values at which it does nothing, possibly only in combination. Where all
    masses of a craft are fitted, only ratios of forces to masses are identifiable, no single parameter."""

    helps: bool  #: whether the effect helps
    change: float  #: relative change of the held-out error: -0.1 is 10% less
    ci95: Tuple[float, float]  #: 95% interval of that change, from its scatter over runs (or pieces)
    reason: str  #: why the effect helps or not
    #: whether it may help although chance explains as much: the error falls, and its size or its predictions
    #: speak for it, or it may fall by more than WORTH
    is_open: bool = False


@dataclass(frozen=True, repr=False)
class Addition(Shown, Estimated):
    """A model with an added effect. The models with and without it are refitted.

    >>> found = ground.add(model_file, "yaw_bias", bag)
    >>> found.effect, found.model.effects, found.verdict.helps
    ('yaw_bias', ('yaw_bias',), True)
    """

    effect: str  #: name of the added effect
    model: Model  #: the model with the effect
    parameters: Dict[str, Parameter]  #: parameters of the model with the effect, by name
    parameters_before: Dict[str, Parameter]  #: parameters of the model without it
    error: Dict[str, Change]  #: errors by kind of runs: fit, heldout and, where given, holdout
    #: errors of predicted poses without the effect and with it, on held-out data; None: too short
    prediction: Optional[PredictionError]
    noise_floor: float  #: error of a true model, from pose noise
    folds: str  #: which data were held out
    window: float  #: length of the windows over which errors are taken [s]
    verdict: Verdict  #: whether the effect helps, and why

    @property
    def answer(self) -> str:
        """Whether the effect helps: "yes", "no" or "not clear"."""
        return "yes" if self.verdict.helps else UNCLEAR if self.verdict.is_open else "no"

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as `identify add --json` prints them."""
        names = ("effect", "parameters", "error", "prediction", "noise_floor", "verdict")
        return {name: records.plain(getattr(self, name)) for name in names}

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the parameters, indexed by name: before (NaN without the effect), start, value, std_error,
        low, high (95%), identified, at_bound, unit."""
        before = [
            self.parameters_before[name].value if name in self.parameters_before else np.nan
            for name in self.parameters
        ]
        frame = parameter_frame(self.parameters)
        frame.insert(0, "before", before)
        return frame

    def save(self, path: Path, force: bool = False) -> Model:
        """Writes the model with the effect; see Model.save."""
        return self.model.save(path, force)

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: whether the effect helps, by how much, and what to do next."""
        own = [p for name, p in self.parameters.items() if name.split(".")[0] == self.effect]
        values = ", ".join("%s %s" % (p.name.split(".", 1)[1], p.words) for p in own)
        by_name = {p.name.split(".", 1)[1]: p for p in own}
        does = effect_words.sentence(
            self.effect,
            {n: effect_words.Estimate.of(p.value, p.ci95, p.unit, p.identified) for n, p in by_name.items()},
        )
        values += ", so that " + does if does else ""
        answer, do = self.answer, DO[self.answer]
        more = words.more_acts(self.prediction, "with", words.diagnosing("addition.model", written))
        if self.verdict.helps and more:
            do = "%s; %s" % (do, more)
        return [
            ("Does it help", "%s - %s: %s; %s." % (answer, self.effect, values, self.verdict.reason)),
            *words.prediction(self.prediction, "without", "with"),
            ("Model with it", (written or "not saved yet") + (" (not better)" if answer == "no" else "")),
            ("Next", do),
        ]

    def details(self) -> Iterator[str]:
        """Lines of text: parameters and errors without the effect and with it."""
        yield "%-28s %12s %12s   %s" % ("parameter", "without", "with", "95% interval")
        for name, p in self.parameters.items():
            was = self.parameters_before.get(name)
            before, unit = "" if was is None else "%.4g" % was.value, p.unit if p.identified else ""
            yield ("%-28s %12s %12.4g   %s %s" % (name, before, p.value, p.interval, unit)).rstrip()
        kinds = {"fit": "the runs fitted to", "heldout": "held out: " + self.folds}
        yield ""
        title = "error over windows of %.3g s" % self.window
        yield "%-48s %8s %8s %8s" % (title, "before", "after", "change")
        for kind, error in self.error.items():
            name = kinds.get(kind, "the held-out runs")
            percent = "%+.0f%%" % (100 * error.change)
            yield "  %-46s %8.3f %8.3f %8s" % (name, error.before, error.after, percent)
        yield "  %-46s %17s" % ("noise floor", words.number(self.noise_floor))


@dataclass(frozen=True)
class AddOptions(bag_arguments.AsRecorded, bag_arguments.Part):
    """Which part of the recordings is used."""


@command_line.takes(AddOptions)
def add(
    model: ModelLike,
    effect: EffectLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    progress: Progress = None,
    options: AddOptions,
) -> Addition:
    """Adds an effect to a model, and tests whether it helps.

    The models with and without the effect are fitted to the recordings, and to all but a part of them.

    Parameters
    ----------
    model : Model or path
        The model without the effect.
    effect : Effect, str, path or mapping
        An effect, the name of a library effect, or a YAML file with one effect, or its content.

    Returns
    -------
    Addition
        The model with the effect, the errors without it and with it, and the verdict.

    Raises
    ------
    GroundError
        When there is no such effect, or the recordings are too short or look misread (swapped channels,
        wrong signs, units or clocks).

    Examples
    --------
    >>> found = ground.add(model_file, "yaw_bias", bag)  # this craft turns by itself
    >>> low, high = found.parameters["yaw_bias.n0"].ci95
    >>> low < 2e-5 < high  # [N m], the moment that turns it
    True
    >>> found.error["heldout"].change < -0.4, found.verdict.helps
    (True, True)
    """
    work = Work.of(progress)
    given, part = Model.of(model), options
    candidate = Effect.of(effect).candidate(given.core)
    extended = candidate.add(given.core)
    seen = measured(recordings, given, part, work)
    held = held_out(holdout, given, part, work, seen)
    if not options.as_recorded:
        seen.refuse_misread()
        held.refuse_misread()
    fitter = window_error.WindowFitter(seen.data)
    fitter.check()
    with work.stage(FITTING, 2 * (1 + len(fitter.parts))):
        before = fitter.fit(given.core, window_error.free_parameters(given.core), work=work)
        refitted = candidates.carried_over(before.model, extended)
        after = fitter.fit(refitted, window_error.free_parameters(extended), also=[extended], work=work)
    errors = {
        "fit": Change(float(before.error.sum()), float(after.error.sum())),
        "heldout": Change(float(before.heldout.sum()), float(after.heldout.sum())),
    }
    if held.data:
        errors["holdout"] = Change(*(windows.error(held.data, fit.model) for fit in (before, after)))
    fits = {"without": before, "with": after}
    seconds, tested = horizon.horizon(seen.data, given.core), held.data or seen.data
    models: Dict[str, ModelsAt] = {name: horizon.same(one.model) for name, one in fits.items()}
    if not held.data:
        models = {name: functools.partial(fitter.models_at, one) for name, one in fits.items()}
    at = horizon.Starts.of(tested, seconds)
    off = {name: at.errors(tested, own(at.windows)) for name, own in models.items()}
    prediction = None
    if len(at.windows):
        position = {name: horizon.PoseError.of(found) for name, found in off.items()}
        prediction = horizon.with_floors(tested, at, position, after.model)
    part_of = window_error.parts_of(tested, at.windows)
    larger, smaller = (judge.Tested(off[name], part_of) for name in ("with", "without"))
    judged = judge.compared(larger, smaller, horizon.what_matters(tested))
    return _result(candidate.name, seen, fitter.windows, before, after, errors, prediction, judged)


def _result(
    effect: str,
    seen: Measured,
    chosen: Sequence[_core.Window],
    before: WindowFit,
    after: WindowFit,
    errors: Dict[str, Change],
    prediction: Optional[PredictionError],
    judged: judge.PairedComparison,
) -> Addition:
    parameters = parameters_by_name(after.parameters)
    model = fitted_model(
        after.model,
        seen.recordings,
        {name: error.before for name, error in errors.items()},
        {name: error.after for name, error in errors.items()},
        parameters,
    )
    folds = "each run by a fit to the others" if len(seen.data) > 1 else "each quarter by a fit to the rest"
    own = candidates.seen_alone(after.model, effect)
    sizes = np.array([w.last - w.first + 1 for w in chosen])  # as the errors weigh windows
    runs = np.array([w.run for w in chosen])
    interval = distributions.ratio_of_means(after.by_window, before.by_window, sizes, runs)
    return Addition(
        effect=effect,
        model=model,
        parameters=parameters,
        parameters_before=parameters_by_name(before.parameters),
        error=errors,
        prediction=prediction,
        noise_floor=float(window_error.noise_floor(seen.data, after.model).sum()),
        folds=folds,
        window=windows.length(seen.data),
        verdict=_verdict(parameters, {p.name: p.neutral for p in own}, interval, errors, judged, folds),
    )


def _verdict(
    parameters: Dict[str, Parameter],
    neutral: Dict[str, float],
    interval: Tuple[float, float],
    errors: Dict[str, Change],
    judged: judge.PairedComparison,
    folds: str,
) -> Verdict:
    """The Verdict on an effect; neutral: values of its parameters at which it does nothing; interval: of the
    ratio of errors on held-out data, which `folds` describes; judged: the model with it and without it."""
    change, ci95 = errors["heldout"].change, (interval[0] - 1, interval[1] - 1)
    told = "the error on held-out data changes by %+.1f%%, 95%%: %+.1f%% to %+.1f%%" % (
        100 * change,
        *(100 * bound for bound in ci95),
    )
    own = [parameters[name] for name in neutral]
    tested = errors.get("holdout")
    if tested:
        told += " (%s); on the runs that you held out by %+.0f%%" % (folds, 100 * tested.change)
    known = [p for p in own if p.identified]
    contain = bool(known) and all(p.ci95[0] <= neutral[p.name] <= p.ci95[1] for p in known)
    speaks = judged.is_better or not contain or ci95[0] < -WORTH
    is_open = change < 0 and bool(known) and speaks and not judged.is_worse
    if change >= 0 or ci95[1] >= 0:
        helps, reason = False, told if known else "its parameters are not identifiable from these data"
    elif contain and not (len(own) > 1 and judged.is_better):
        helps, reason = False, "its 95% intervals contain the values at which it does nothing"
    elif judged.is_worse:
        helps, reason = False, "the effect makes predictions of held-out data worse"
    elif tested and tested.change > 0:
        percent = 100 * tested.change
        helps, reason = False, "the error on the holdout runs rises by %.1f%%" % percent
    else:
        helps, reason = True, told + "; its parameters are identifiable only in combination" * contain
    return Verdict(helps, change, ci95, reason, is_open and not helps)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify add."""
    parser.add_argument(
        "effect",
        metavar="EFFECT",
        help="name of a library effect, or a YAML file with one effect as in a model file",
    )
    bag_arguments.configure_fit(parser, "model to which the effect is added", "N.yaml", AddOptions)
    parser.epilog = "effects of the library: " + ", ".join(candidates.effects())


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify add; returns what --json prints."""
    return bag_arguments.run_fit(arguments, add, AddOptions, arguments.effect)
