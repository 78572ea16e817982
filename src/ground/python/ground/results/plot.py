"""plot: the figures of recordings and results, one by one."""

import functools
import html
import os
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional

import numpy as np

from ground import _core
from ground.analysis import comparison
from ground.comparing import page as comparing_page
from ground.comparing.predict import Prediction
from ground.comparing.result import Comparison
from ground.control.track import Tracking
from ground.diagnosing import page as diagnosing_page
from ground.diagnosing.drawn import Drawn
from ground.diagnosing.result import Diagnosis
from ground.discovery import figures as discovery_figures
from ground.discovery.discover import Discovery
from ground.fitting.result import Fit
from ground.ledger import figures as history_figures
from ground.ledger.result import History
from ground.reading.recording import VELOCITY, Recording
from ground.reports import figures, run_figures, tracking_figures, wrench_figures
from ground.reports.inspection import Inspection, PredictionBand, SimulatedMotion
from ground.support.annotations import Plotly
from ground.support.docstrings import Described
from ground.support.errors import GroundError

Makers = Dict[str, Callable[[], Any]]  # documents of plotly


class Figures(Described, Mapping[str, Any]):
    """Plotly figures by name. Each is drawn on first access; a notebook shows all.

    >>> drawn = ground.compare(model_file, bag).plot()
    >>> list(drawn)
    ['errors', 'motion run', 'wrench run', 'residuals run']
    >>> len(drawn["errors"].data)  # position and heading
    2
    """

    def __init__(self, makers: Makers) -> None:
        self._makers = makers

    def __getitem__(self, name: str) -> Any:
        import plotly.graph_objects

        found = [key for key in self._makers if key == name or key.split(" ")[0] == name]
        if not found or (len(found) > 1 and name not in self._makers):
            raise GroundError("there is no figure %s; there are %s" % (name, ", ".join(self._makers)))
        made = self._makers[name if name in self._makers else found[0]]()
        return plotly.graph_objects.Figure(made)

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)

    def show(self) -> None:
        """Shows all figures in the browser."""
        for name in self:
            self[name].show()

    def _repr_html_(self) -> str:
        parts = [
            "<h4>%s</h4>%s" % (html.escape(name), self[name].to_html(full_html=False, include_plotlyjs=not i))
            for i, name in enumerate(self)
        ]
        return "".join(parts)


def plot(result: Any, name: str = "") -> Any:
    """Draws the figures of a recording or a result; also `result.plot(name)`.

    - Recording: motion
    - Prediction: motion, residuals
    - Fit: parameters, correlation; motion RUN
    - Comparison, Diagnosis: errors; motion RUN, wrench RUN and residuals RUN
    - Tracking: run N
    - Discovery: errors; flight N
    - History: PARAMETER

    Parameters
    ----------
    result : Recording, Prediction, Fit, Comparison, Diagnosis, Tracking, Discovery or History
        The object to draw.
    name : str, optional
        Name of one figure; "motion" is enough for a single run.

    Returns
    -------
    plotly.graph_objects.Figure or Figures
        The figure of that name, or the only one; otherwise all. layout.meta of a figure is its caption.

    Raises
    ------
    GroundError
        When there is no figure of that name.

    Examples
    --------
    >>> run, = ground.read(bag)
    >>> figure = ground.plot(run)
    >>> [trace.name for trace in figure.data][:2]
    ['measured', 'measured']
    >>> ground.load(model_file).predict(run).plot("sketch")
    Traceback (most recent call last):
    ...
    ground.support.errors.GroundError: there is no figure sketch; there are motion, residuals
    """
    found = Figures(_makers(result))
    if not found:
        raise GroundError("there is nothing to draw")
    if name:
        return found[name]
    return found if len(found) > 1 else found[next(iter(found))]


@functools.singledispatch
def _makers(result: Any) -> Makers:
    """Functions that draw the figures of a result, by name."""
    raise GroundError("ground.plot draws results and recordings, not %s" % type(result).__name__)


@_makers.register(Recording)
def _of_recording(result: Recording) -> Makers:
    return {"motion": lambda: run_figures.recorded(result)}


@_makers.register(Prediction)
def _of_prediction(result: Prediction) -> Makers:

    def motion() -> Plotly:
        band, model = None, result.model
        sizes = np.abs(result.residuals[:, 3:]).mean(axis=0) / np.array(result.run.nu).std(axis=0)
        if result.band is not None and result.low is not None and result.high is not None:
            at = np.flatnonzero(np.diff(result.start)) + 1
            band = PredictionBand(result.band, np.split(result.low, at), np.split(result.high, at))
        how = "again and again for %.3g s" if result.starts > 1 else "once, for %.3g s"
        shaded = "" if result.band is None else " Shaded: band of %.0f%%." % (100 * result.band)
        caption = "Predicted %s.%s %s" % (how % result.horizon, shaded, result)
        errors = dict(zip(VELOCITY, sizes))
        study = SimulatedMotion(model.label, result.run, model.core, result.pieces, errors, band)
        return figures.motion([study], caption=caption)

    return {
        "motion": motion,
        "residuals": lambda: run_figures.residuals(result.times, result.residuals, str(result)),
    }


@_makers.register(Fit)
def _of_fit(result: Fit) -> Makers:
    core, names = result.model.core, list(result.parameters)

    def motion(run: _core.RunData) -> Plotly:
        evaluated = comparison.evaluate(run, core)
        errors = comparison.numbers([evaluated])["error_by_channel"]
        study = SimulatedMotion("the fitted model", run, core, evaluated.pieces, errors, None)
        return figures.motion([study])

    rows = [(run.run, run.parameters, run.ci95) for run in result.runs]
    values = {name: p.value for name, p in result.parameters.items()}
    rows.append(("all", values, {name: p.ci95 for name, p in result.parameters.items()}))
    units = {name: p.unit for name, p in result.parameters.items()}
    return {
        "parameters": lambda: run_figures.parameters(rows, units),
        "correlation": lambda: run_figures.correlation(names, result.correlations),
        **{"motion " + run.name: functools.partial(motion, run) for run in result.data},
    }


@_makers.register(Comparison)
def _of_comparison(result: Comparison) -> Makers:
    made = _errors(comparing_page.predictions(result.ranking, result.prediction))
    for run in result.runs:
        if run.recording is not None:
            made.update(_of_studies(run.name, functools.partial(getattr, run, "inspections")))
    return made


@_makers.register(Diagnosis)
def _of_diagnosis(result: Diagnosis) -> Makers:
    drawn = result.drawn
    made = _errors(diagnosing_page.predictions(result.contents))
    if drawn is not None:
        for number, run in enumerate([*drawn.runs, *drawn.held]):
            inspected = functools.lru_cache(maxsize=None)(functools.partial(_inspected, drawn, number))
            made.update(_of_studies(run.name, inspected))
    return made


@_makers.register(Tracking)
def _of_tracking(result: Tracking) -> Makers:
    title = "%s, %s" % (result.controller, result.reference)
    return {
        "run %d" % number: functools.partial(
            tracking_figures.driven, run, tracking_figures.caption(title, run.numbers), result.window
        )
        for number, run in enumerate(result.runs, 1)
    }


@_makers.register(Discovery)
def _of_discovery(result: Discovery) -> Makers:
    story = result.story
    made: Makers = {}
    if any(flown.errors for flown in story.flights):
        made["errors"] = lambda: discovery_figures.errors(story) or {}
    folder = os.path.dirname(result.page)
    for flown in story.flights:
        if not flown.path:
            continue
        file = os.path.join(folder, flown.flight.inputs) if folder and flown.flight.inputs else ""
        rows = np.loadtxt(file, delimiter=",", skiprows=1) if os.path.isfile(file) else None
        names = [t["name"].replace("_", " ") for t in result.model.core.thrusters]
        made["flight %d" % flown.flight.number] = functools.partial(
            discovery_figures.flight, flown.flight, flown, rows, names
        )
    return made


@_makers.register(History)
def _of_history(result: History) -> Makers:
    return {
        name: functools.partial(history_figures.of, result.contents, *of)
        for name, of in history_figures.by_name(result.contents).items()
    }


def _errors(found: Optional[Plotly]) -> Makers:
    """The figure of how far predicted poses are off, where runs are long enough."""
    return {} if found is None else {"errors": functools.partial(dict, found)}


def _inspected(drawn: Drawn, number: int) -> List[Inspection]:
    """Inspections of a run of a diagnosis."""
    return drawn.inspected([number])[0]


def _of_studies(run: str, studies: Callable[[], List[Inspection]]) -> Makers:
    """The figures of a run against models."""
    return {
        "motion " + run: lambda: figures.motion(studies()),
        "wrench " + run: lambda: wrench_figures.wrench_over_time(studies()),
        "residuals " + run: lambda: figures.residual_correlation(studies()),
    }
