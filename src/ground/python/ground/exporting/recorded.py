"""A recorded run, and what models predict of it, as an MCAP file."""

import math
import os
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Union

import numpy as np

from ground import _core
from ground.analysis import missing_wrench
from ground.data.read import taken
from ground.exporting import viewers
from ground.exporting.channels import MODELS, NANOSECONDS
from ground.models import Model, ModelLike, Room
from ground.poses import repair
from ground.reading.recording import Recording
from ground.support import files
from ground.support.annotations import Array, Indices, Path
from ground.support.docstrings import complete
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.results import Shown, distinct_labels

if TYPE_CHECKING:
    import pandas

    from ground import Prediction
    from ground.exporting.view import View

LAYOUT = "cfg/foxglove/ground.json"


@dataclass(frozen=True, repr=False)
class ExportedRun(Shown):
    """A run that was written to an MCAP file.

    >>> import tempfile
    >>> written = ground.to_mcap(bag, tempfile.mkdtemp() + "/run.mcap", [model_file])
    >>> sorted(written.counts)[:3], written.models
    (['/commands', '/log', '/model/accuracy'], ['tiny_whoover'])
    """

    path: str  #: path of the file
    name: str  #: name of the run
    duration: float  #: duration of the run [s]
    models: List[str]  #: labels of the models, in the order of the channels /model and /model2
    horizon: float  #: how far ahead the models predict [s]; 0 without models
    counts: Dict[str, int]  #: number of messages by channel, without the scene

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what was written, and how to view it."""
        what = "%s, %.1f s: %d messages on %d channels, and the scene"
        what = what % (self.name, self.duration, sum(self.counts.values()), len(self.counts))
        models = ["/%s is %s" % (topic, label) for topic, label in zip(MODELS, self.models)]
        told = "%s, %g s ahead" % (", ".join(models), self.horizon) if models else "none given"
        how = "open it in Foxglove, Lichtblick, PlotJuggler or rerun; layout of the first two: " + LAYOUT
        return [("Exported", what), ("Models", told), ("File", self.path), ("Next", how)]

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the number of messages by channel."""
        import pandas

        return pandas.DataFrame({"messages": self.counts}).rename_axis("channel")

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as `identify export --json` prints them."""
        names = ("path", "name", "duration", "models", "horizon", "counts")
        return {name: getattr(self, name) for name in names}


class ChannelWriter(NamedTuple):
    """What is written to a channel: at which times [ns], and a function that writes what was true then."""

    channel: str
    times: Indices
    write: Callable[[int, int], None]  # takes a time [ns] and its index


@complete
def to_mcap(
    recording: "Union[Recording, Path]",
    path: Path,
    models: Iterable[ModelLike] = (),
    horizon: Optional[float] = None,
    force: bool = False,
) -> ExportedRun:
    """Writes a run to an MCAP file, for Foxglove and other viewers.

    The file contains the measured poses, the state, the commands and the room; for each model its
    predictions, their errors, and the missing force.

    Parameters
    ----------
    models : iterable of Model or path, optional
        Up to two models whose predictions are written.

    Raises
    ------
    GroundError
        When there are more than two models, a model cannot predict the run, foxglove-sdk is not installed, or
        the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> print(ground.to_mcap(bag, tempfile.mkdtemp() + "/run.mcap", [model_file], horizon=1.0).models)
    ['tiny_whoover']
    """
    viewers.require()
    from ground.exporting.view import View  # needs foxglove-sdk

    place, given = os.fspath(path), [Model.of(model) for model in models]
    files.refuse_existing(place, force)
    if len(given) > len(MODELS):
        raise GroundError("an MCAP file holds at most %d models, not %d" % (len(MODELS), len(given)))
    found = taken(recording)
    if len(found) != 1:
        raise GroundError("an MCAP file holds one run, not %d" % len(found))
    run = found[0].with_lift_of(given[0].core) if given else found[0]
    labels = distinct_labels([m.label for m in given], [m.path for m in given])
    predicted: "List[Prediction]" = []
    for model in given:
        predicted.append(model.predict(run, horizon))
        horizon = horizon or predicted[0].horizon
    missing = [_missing(made) for made in predicted]
    with files.new_file(place, force) as temporary:
        os.unlink(temporary)  # foxglove writes new files only
        context = viewers.context()
        with viewers.recorded(context, temporary) as file:
            view = View(context)
            view.furnish(given[0] if given else None, Room.of_recording(run))
            sources = [*_measured(view, run), *_changes(view, run)]
            for i, (label, made, inferred) in enumerate(zip(labels, predicted, missing)):
                sources += _predicted(view, i, label, made)
                sources += _missing_source(view, i, label, inferred, made.zero)
            _write(sources)
            _describe(file, run, given)
    counts: Dict[str, int] = Counter()
    for source in sources:
        counts[source.channel] += len(source.times)
    return ExportedRun(
        place,
        run.name,
        run.duration,
        labels,
        horizon or 0.0,
        {topic: count for topic, count in counts.items() if count},
    )


def _measured(view: "View", run: Recording) -> List[ChannelWriter]:
    """Poses as measured, the state, and the commands."""
    stamps = repair.on_commands_clock(run.pose_times, run.clock_offset)
    motion = run.motion
    repaired = motion.measured
    order = np.argsort(stamps, kind="stable")
    poses, states = run.eta[order].tolist(), np.column_stack([repaired, motion.nu]).tolist()
    commands = run.controls.tolist()
    return [
        ChannelWriter(
            "/commands", _at(run.control_times), lambda at, i: view.commands(at, run.channels, commands[i])
        ),
        ChannelWriter("/pose", _at(stamps[order]), lambda at, i: view.pose(at, poses[i])),
        ChannelWriter(
            "/state", _at(motion.times), lambda at, i: view.state(at, states[i][:3], states[i][3:])
        ),
    ]


def _predicted(view: "View", model: int, label: str, made: "Prediction") -> List[ChannelWriter]:
    """What a model predicts sample by sample; and at both ends of this, how far it is off at the horizon."""
    rows, off, ahead = made.predicted.tolist(), made.residuals[:, :3].tolist(), made.ahead.tolist()
    error, noise = (
        (1e-3 * mm, math.radians(deg))
        for mm, deg in ((made.position_mm, made.heading_deg), (made.noise_mm, made.noise_deg))
    )
    times = _at(made.times + made.zero)

    def write(at: int, i: int) -> None:
        view.prediction(model, at, label, ahead[i], rows[i][:3], rows[i][3:], off[i])

    def summarise(at: int, i: int) -> None:
        view.accuracy(model, at, label, error, noise, made.horizon)

    topic = "/%s/" % MODELS[model]
    told = "off by %.3g mm, %.2g deg after %.2g s, noise floor %.2g mm, %.2g deg" % (
        made.position_mm, made.heading_deg, made.horizon, made.noise_mm, made.noise_deg
    )  # fmt: skip
    return [
        ChannelWriter("/log", times[:1], lambda at, i: view.say(at, label, told)),
        ChannelWriter(topic + "accuracy", times[[0, -1]], summarise),
        ChannelWriter(topic + "prediction", times, write),
    ]


def _missing(made: "Prediction") -> missing_wrench.MissingWrench:
    """The missing wrench of the model of a prediction along its run."""
    core = made.model.core
    return missing_wrench.of_wrench(missing_wrench.undisturbed(core, made.run), core)


def _missing_source(
    view: "View", model: int, label: str, inferred: missing_wrench.MissingWrench, zero: float
) -> List[ChannelWriter]:
    """The missing wrench, and the spans that are left out of it; zero: origin of the times on the recording's
    clock [s]."""
    wrench, sigma = inferred.wrench.tolist(), inferred.sigma.tolist()
    times = _at(inferred.times + zero)
    spans = [(one.start, one.end - one.start) for one in inferred.numbers.disturbances]

    def told(at: int, i: int) -> None:
        words = "no input explains the motion of the next %.1f s (contact, hand, wrong poses)" % spans[i][1]
        view.say(at, label, words, "warning")

    topic = "/%s/missing" % MODELS[model]
    return [
        ChannelWriter(topic, times, lambda at, i: view.missing(model, at, label, wrench[i], sigma[i])),
        ChannelWriter("/log", _at(np.array([start for start, _ in spans]) + zero), told),
    ]


def _changes(view: "View", run: Recording) -> List[ChannelWriter]:
    """Where the run begins, and changes of parameters and models during it."""
    changes = run.changes

    def change(at: int, i: int) -> None:
        one = changes[i]
        view.change(at, one.node, one.name, one.before, one.after)

    begins = _at(run.pose_times.min(keepdims=True))
    return [
        ChannelWriter("/log", begins, lambda at, i: view.say(at, "run", run.name)),
        ChannelWriter("/log", _at(np.array([one.time for one in changes])), change),
    ]


def _write(sources: Sequence[ChannelWriter]) -> None:
    """Writes everything in order of time."""
    times = np.concatenate([source.times for source in sources])
    which = np.repeat(np.arange(len(sources)), [len(source.times) for source in sources])
    places = np.concatenate([np.arange(len(source.times)) for source in sources])
    for k in np.argsort(times, kind="stable"):
        sources[which[k]].write(int(times[k]), int(places[k]))


def _describe(file: Any, run: Recording, models: Sequence[Model]) -> None:
    """Adds where the run comes from, and the files of the models."""
    told = {"run": run.name, "recording": run.bag, "digest": run.identity, "ground": _core.version}
    file.write_metadata("ground", told)
    for name, model in zip(MODELS, models):
        text = model.format().encode()
        file.attach(log_time=0, create_time=0, name=name + ".yaml", media_type="text/yaml", data=text)


def _at(times: Array) -> Indices:
    """Times [ns] of times [s]."""
    return np.asarray(np.rint(times * NANOSECONDS), np.int64)
