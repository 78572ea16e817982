"""A fit, and its lines of text."""

import math
import shlex
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.analysis.distributions import student_limit
from ground.analysis.horizon import PredictionError
from ground.analysis.likelihood import step
from ground.effect_library.parameters import described
from ground.models import Estimated, Model, Parameter, parameter_frame
from ground.support import records
from ground.support.annotations import Array, Path
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.public import public
from ground.support.results import Plotted, Shown, with_units

if TYPE_CHECKING:
    import pandas

    from ground import Prediction
    from ground.analysis.predicted_band import FitWithout
    from ground.fitting.identifiability import WeakDirection
    from ground.reading.recording import Recording

MAX_RATIO = 100.0  # ratio to the start value of a parameter at its bound that is none of the craft


@dataclass(frozen=True)
class Change:
    """Errors before and after: of start values and fit, or without an effect and with it."""

    before: float
    after: float

    @property
    def change(self) -> float:
        """Relative change of the error: -0.1 is 10% less."""
        return self.after / self.before - 1


@dataclass(frozen=True)
class ThesisObjective:
    """The thesis's objective (3.4) over the first 4 s of runs, with the start values and with the fit;
    None for shorter runs."""

    before: Optional[float]
    after: Optional[float]


@dataclass(frozen=True)
class Errors:
    """Mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r over windows."""

    before: float  #: error of the start values
    after: float  #: error of the fit
    #: error on held-out data: each run by a fit to the others, each quarter of a single run by a fit to
    #: the rest; None: too short
    heldout: Optional[float]
    holdout: Optional[Change]  #: errors on the holdout runs; None without such runs


@dataclass(frozen=True)
class RunFit:
    """One run fitted by itself, and held out of a fit to the others (the thesis's table 3.2)."""

    run: str
    parameters: Dict[str, float]  #: estimates by name, in the units of Fit.parameters
    ci95: Dict[str, Tuple[float, float]]  #: their 95% intervals
    error: float  #: error of a fit to this run only
    heldout_error: float  #: error of a fit to the other runs
    disagrees_in: List[str]  #: parameters whose estimate differs from the other runs


class _Lacking(GroundError, AttributeError):
    """What a fit does not have."""


@dataclass(frozen=True, repr=False)
class Fit(Shown, Plotted, Estimated):
    """A model fitted to recordings.

    >>> found = ground.fit(model_file, bag, free=["k", "N_r"])
    >>> narrow, wide = found.conf_int(0.5), found.conf_int(0.99)
    >>> wide.loc["k", "low"] < narrow.loc["k", "low"] < found.model["k"]
    True
    >>> found.correlation.loc["k", "k"], list(found.to_frame())
    (1.0, ['start', 'value', 'std_error', 'low', 'high', 'identified', 'at_bound', 'unit'])
    >>> found.params["k"] == found.model["k"], found.bse["k"] > 0
    (True, True)
    >>> "95% interval" in found.summary()
    True
    >>> hasattr(found, "aic")  # a diagnosis has one
    False
    >>> found.predict(bag).position_mm < 100  # after 1.5 s
    True
    """

    model: Model  #: the fitted model
    parameters: Dict[str, Parameter]  #: the free parameters, by name
    error: Errors  #: errors of the start values, of the fit, and on held-out data
    #: errors of poses predicted by the given and the fitted model, on held-out data; None: too short
    prediction: Optional[PredictionError]
    thesis_objective: ThesisObjective  #: objective (3.4) of the start values and of the fit
    objective: float  #: the minimised value
    starts: Dict[str, int]  #: number of starts tried, and of those that reached this optimum
    condition: float  #: condition number of the scaled information matrix
    weak: "List[WeakDirection]"  #: combinations of parameters known better than their members
    converged: bool  #: whether the search has converged
    runs: List[RunFit]  #: fits to each run; empty for a single run
    same_inputs: List[Tuple[str, str]]  #: pairs of runs with the same commands
    remarks: List[str]  #: sentences on what is not identifiable
    given: Model  #: the given model, with the start values
    #: (n, n) correlation of the estimates, in the order of parameters
    correlations: Array = field(compare=False)
    freedom: float  #: degrees of freedom of Student's t for the intervals
    data: List[_core.RunData] = field(compare=False)  #: the parts of the runs fitted to
    #: what corrects recordings that look misread
    corrections: List[str] = field(default_factory=list, compare=False)
    #: for several runs, fits that leave out some of them; they give the bands of predictions
    parts: "List[FitWithout]" = field(default_factory=list, compare=False)

    def predict(
        self,
        recording: "Union[Recording, Path]",
        horizon: Optional[float] = None,
        band: Optional[float] = None,
        **options: Any,
    ) -> "Prediction":
        """Predicts a recording with the fitted model; see ground.predict.

        A band's shape comes from the differences between fits without each run, its size from their error on
        the run that they leave out.

        Parameters
        ----------
        band : float, optional
            Share of the samples that a band about the prediction should contain, such as 0.9.
        **options
            Options of ground.predict.

        Raises
        ------
        GroundError
            When the run is too short, or the model was fitted to a single run and has no band.
        """
        made: Prediction = public("predict")(self.model, recording, horizon, band, self.parts, **options)
        return made

    def conf_int(self, level: float = 0.95, *, alpha: Optional[float] = None) -> "pandas.DataFrame":
        """Confidence intervals of the parameters, from Student's t of their coordinates.

        Parameters
        ----------
        level : float, default 0.95
            Probability that an interval contains the true value, at least 0.5 and below 1.
        alpha : float, optional
            One minus the level, as in statsmodels.

        Returns
        -------
        DataFrame
            Columns low and high in the units of the parameters, indexed by their names.

        Raises
        ------
        GroundError
            When the level is below 0.5, which is probably an alpha, or not below 1.
        """
        from ground.analysis.score_tests import moved

        level = level if alpha is None else 1 - alpha
        if not 0.5 <= level < 1:
            hint = "; for this alpha, conf_int(%g) or conf_int(alpha=%g)" % (1 - level, level)
            text = "a confidence level must be at least 0.5 and below 1, not %g%s"
            raise GroundError(text % (level, hint if 0 < level < 0.5 else ""))
        factor = student_limit(0.5 - level / 2, self.freedom) / student_limit(0.025, self.freedom)
        known = described(self.model.core)
        frame = self.to_frame()
        for p in self.parameters.values():
            if p.identified:
                # one end may be an end of the range
                reach = factor * max(abs(step(known[p.name], p.value, end)) for end in p.ci95)
                ends = sorted(moved(known[p.name], p.value, by) for by in (-reach, reach))
                frame.loc[p.name, ["low", "high"]] = ends
        return frame[["low", "high"]]

    @property
    def llf(self) -> float:
        """Raises GroundError: a fit minimises a simulation error and has no log-likelihood; a diagnosis has
        one."""
        raise _Lacking(
            "a fit minimises a simulation error and has no likelihood; a diagnosis fits by likelihood and "
            "has llf, aic and bic: ground.diagnose(fit.model, RECORDINGS)"
        )

    @property
    def aic(self) -> float:
        """Raises GroundError: a fit has no information criterion, as it has no `llf`."""
        return self.llf

    @property
    def bic(self) -> float:
        """Raises GroundError: a fit has no information criterion, as it has no `llf`."""
        return self.llf

    @property
    def correlation(self) -> "pandas.DataFrame":
        """Correlation of the estimates, indexed by parameter name."""
        import pandas

        names = list(self.parameters)
        return pandas.DataFrame(self.correlations, names, names)

    @property
    def covariance(self) -> "pandas.DataFrame":
        """Covariance of the estimates, in their units; NaN for parameters that are not identified."""
        deviations = np.array([p.deviation for p in self.parameters.values()])
        deviations[~np.isfinite(deviations)] = math.nan
        return self.correlation * np.outer(deviations, deviations)

    @property
    def residuals(self) -> "pandas.DataFrame":
        """Measured minus simulated velocities of the runs fitted to, in windows: run, t [s], u, v
        [m/s], r [rad/s]."""
        import pandas

        frames = []
        for run in self.data:
            cut = windows.cut([run])
            simulated = windows.problem([run], cut).simulate(self.model.core)["nu"]
            index = np.concatenate([np.arange(w.first, w.last + 1) for w in cut])
            off = np.array(run.nu)[index] - np.vstack(simulated)
            frame = pandas.DataFrame(off, columns=["u", "v", "r"])
            frame.insert(0, "t", np.array(run.times)[index])
            frame.insert(0, "run", run.name)
            frames.append(frame)
        units = {"t": "s", "u": "m/s", "v": "m/s", "r": "rad/s"}
        return with_units(pandas.concat(frames, ignore_index=True), units)

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as `identify fit --json` prints them."""
        parameters = {name: records.plain(p) for name, p in self.parameters.items()}
        for values in parameters.values():
            del values["name"]
        names = (
            *("error", "prediction", "thesis_objective", "objective", "starts", "condition", "weak"),
            *("converged", "runs", "same_inputs"),
        )
        return {"parameters": parameters, **{name: records.plain(getattr(self, name)) for name in names}}

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the parameters, indexed by name: start, value, std_error, low, high (95%), identified,
        at_bound, unit."""
        return parameter_frame(self.parameters)

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave.

        The file contains structs `models`, `parameters` and `runs` with the measured motion and the
        predictions of the models "start" and "fitted"; its text `about` explains units and frames.
        """
        from ground.reports import matlab

        models = {"start": self.given, "fitted": self.model}
        matlab.write(path, models, matlab.studies(models, self.data), force)

    def save(self, path: Path, force: bool = False) -> Model:
        """Writes the fitted model; see Model.save."""
        return self.model.save(path, force)

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what was fitted, how well it predicts, and what to do next."""
        from ground.reports import words

        prediction = words.prediction(self.prediction, "given", "fitted")
        unknown = [p.name for p in self.parameters.values() if not p.identified]
        told = "%s of %s" % (words.listed(list(self.parameters)), self.model.name)
        if unknown:
            told += "; %s cannot be identified from these runs" % words.listed(unknown)
        if not self.converged:
            told += "; the fit has not converged"
        return [
            ("Fitted", told + "."),
            *prediction,
            ("Model", written or "not saved yet"),
            ("Next", self._next(unknown, written)),
        ]

    @property
    def runaway(self) -> List[Parameter]:
        """Parameters that ran to the end of their range, far from the start values: the model does not fit
        the craft."""
        return [
            p
            for p in self.parameters.values()
            if p.at_bound and p.value and p.start and not 1 / MAX_RATIO < abs(p.value / p.start) < MAX_RATIO
        ]

    def _next(self, unknown: Sequence[str], written: str) -> str:
        from ground.reports import words

        if self.given.doubts:
            return "correct the given model, and fit again: %s" % self.given.doubts[0]
        if self.corrections:
            return "correct how the recordings are read (%s), and fit again" % "; ".join(self.corrections)
        unit = words.unit_of_length(self.parameters.values())
        if unit:
            return "check the unit of the positions, and fit again: %s" % unit
        if self.runaway:
            far = ("%s = %.2g %s" % (p.name, p.value, p.unit) for p in self.runaway)
            return (
                "do not use this model: %s ran to the end of its range, so the runs contradict it; check "
                "the runs, thrusters, units and missing effects" % ", ".join(far)
            )
        if unknown:
            return "fix %s, or record runs with other commands" % words.listed(list(unknown))
        worse = self.prediction and words.ratio(*(self.prediction.errors[n] for n in ("fitted", "given"))) > 1
        more = words.more_acts(self.prediction, "fitted", words.diagnosing("fit.model", written))
        if more:
            return "the fit predicts no better than the given model; " * bool(worse) + more
        if self.prediction is None:
            return "record longer runs, to measure the prediction error"
        tests = "ground.compare(fit.model, OTHER_RECORDINGS)"
        if written:
            tests = "rosrun ground identify compare OTHER_BAGS --model %s -o compare" % shlex.quote(written)
        return "test the model on runs that it was not fitted to:\n" + tests

    def table(self) -> Iterator[str]:
        """Lines of text: the fitted parameters."""
        yield "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval")
        for p in self.parameters.values():
            unit = p.unit if p.identified else ""
            yield "%-18s %12.4g %12s   %s %s" % (p.name, p.start, p.number, p.interval, unit)
        yield from self.remarks

    def details(self) -> Iterator[str]:
        """Lines of text: errors, each run, and how many starts agree."""
        title = "error over windows of %.3g s" % windows.length(self.data)
        yield "%-50s %8s %8s %9s" % (title, "start", "fitted", "held out")
        for what, values in self._errors():
            yield "  %-48s %8s %8s %9s" % ((what,) + tuple("" if v is None else "%.3f" % v for v in values))
        if self.data:
            noise = np.max([run.noise for run in self.data], axis=0)
            told = 1e3 * noise[0], np.degrees(noise[2])
            yield "assumed pose noise: up to %.2g mm, %.2g deg" % told
        if self.runs:
            yield ""
            yield from _table(list(self.parameters), self.runs)
        same = sorted({name for pair in self.same_inputs for name in pair})
        if same:
            yield "the same commands drove %s: testing one on the others is optimistic" % ", ".join(same)
        if self.starts["tried"] > 1:
            yield "%(at_best)d of %(tried)d starts reached this optimum" % self.starts

    def _errors(self) -> Iterator[Tuple[str, Tuple[Optional[float], ...]]]:
        """Data, and the error there of the start values, of the fit, and held out."""
        errors, thesis = self.error, self.thesis_objective
        what = "the run; held out: each quarter by a fit to the rest"
        if self.runs:
            what = "all runs; held out: each by a fit to the others"
        yield what, (errors.before, errors.after, errors.heldout)
        if errors.holdout:
            yield "the held-out runs", (errors.holdout.before, None, errors.holdout.after)
        if thesis.after is not None:
            yield "(3.4) over the first 4 s", (thesis.before, thesis.after, None)


def _table(names: Sequence[str], rows: Sequence[RunFit]) -> Iterator[str]:
    """One row per run, then mean and spread, as in the thesis's table 3.2."""
    width = max(map(len, [row.run for row in rows] + ["spread"]))
    head = "".join("%11s" % n.split(".")[-1] for n in names)
    yield "%-*s %s%9s%10s" % (width, "run", head, "error", "held out")
    for row in rows:
        estimates = "".join("%11.4g" % row.parameters[n] for n in names)
        errors = "%9.3f%10.3f" % (row.error, row.heldout_error)
        yield "%s %s%s" % (row.run.ljust(width), estimates, errors)
    table = np.array([[row.parameters[n] for n in names] for row in rows])
    for name, values in (("mean", table.mean(axis=0)), ("spread", table.std(axis=0, ddof=1))):
        yield "%s %s" % (name.ljust(width), "".join("%11.4g" % v for v in values))
    for row in rows:
        if row.disagrees_in:
            yield "%s disagrees with the others in %s: inspect it before pooling the runs" % (
                row.run,
                ", ".join(row.disagrees_in),
            )
