"""info: contents, anomalies and repairs of recordings."""

import argparse
import math
import os
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Sequence, Tuple

from ground import _core
from ground.checks import findings, imitations, layouts, suspicions
from ground.data import bag_arguments
from ground.data.measured import repaired
from ground.data.read import NO_RECORDING, Recordings, taken
from ground.draft import drafts
from ground.models import Model, ModelLike
from ground.reading import mapping, readers, recorded_files
from ground.reading.gathered import CAME_LATE
from ground.reading.recording import NOT_SECONDS, Recording
from ground.reports import words
from ground.support import command_line, files
from ground.support.annotations import Document
from ground.support.docstrings import internal
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.progress import Progress, Work
from ground.support.results import Shown, with_units

if TYPE_CHECKING:
    import pandas

UNDECIDED = "nothing seen to correct, but whether channels and heading are as recorded is undecided"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    bag_arguments.add_bag_arguments(parser)
    parser.add_argument(
        "--write-mapping",
        metavar="M.yaml",
        dest="output",
        help="draft a mapping file for the first recording, with the evidence, instead of the report",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL.yaml",
        help="model of the craft: find from the motion which channel drives which of its thrusters",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the mapping file")


@dataclass(frozen=True, repr=False)
class Info(Shown):
    """What recordings contain, what is odd in them, and which part of them is usable.

    >>> found = ground.info(bag)
    >>> list(found.to_frame())
    ['duration', 'usable', 'poses', 'rate', 'position_noise', 'heading_noise', 'odd']
    >>> round(found.runs[0]["usable"]["duration"])  # [s]
    20
    """

    runs: List[Document]  #: what `identify info --json` prints of each run
    doubts: Tuple[str, ...]  #: findings on several runs together, in sentences
    mappings: Dict[str, str]  #: the text of the mapping that was drafted to read a run, by its name
    layout: str  #: which channel drives which thruster, in a sentence; empty without a model
    read: Tuple[str, ...] = ()  #: the arguments of the command line that name the recordings
    model: str = "MODEL"  #: the model that `read` names, as the command line takes it
    is_open: bool = False  #: whether the recordings leave open what channels and heading are

    @internal
    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: how much is usable, how good the poses are, and what to do next."""
        return list(self._first_lines())

    def _first_lines(self) -> Iterator[Line]:
        usable = sum(float(d["usable"]["duration"]) for d in self.runs)
        whole = sum(float(d["duration"]) for d in self.runs)
        count = "%d recording%s" % (len(self.runs), "" if len(self.runs) == 1 else "s")
        yield "Usable", "%.1f of %.1f s in %s." % (usable, whole, count)
        position, heading = (
            max(float(d["poses"]["noise"][k]) for d in self.runs) for k in ("position", "heading")
        )
        rate = min(float(d["poses"]["rate"]) for d in self.runs)
        yield (
            "Poses",
            "%.4g Hz or more; noise up to %s, %s deg"
            % (rate, words.millimetres(1e3 * position), words.two_digits(math.degrees(heading))),
        )
        doubtful = self._doubtful()
        if self.doubts:
            yield "Next", "look at " + self.doubts[0]
        elif doubtful:
            yield "Next", "look at %s: %s" % (", ".join(doubtful), next(iter(doubtful.values())))
        else:
            fits = "ground.fit(MODEL, RECORDINGS)"
            if self.read:
                names = " ".join(map(shlex.quote, self.read))
                fits = "rosrun ground identify fit %s --model %s -o fitted.yaml" % (names, self.model)
            yield "Next", "%s; fit a model:\n%s" % (UNDECIDED if self.is_open else "nothing to correct", fits)

    def _doubtful(self) -> Dict[str, str]:
        """The worst of each run that has to be looked at before it is used, by its name."""
        return {d["name"]: odd[0] for d in self.runs for odd in [_worst(d)] if odd}

    @internal
    def table(self) -> Iterator[str]:
        """What each recording contains, and what is odd in it besides what the first lines tell."""
        told = [] if self.doubts else list(self._doubtful().items())[:1]
        for i, d in enumerate(self.runs):
            yield from [""] * (i > 0) + [d["name"]]
            for name, value in findings.facts(d):
                yield "  %-11s %s" % (name, value)
            for finding in findings.findings(d):
                if (d["name"], finding) not in told:
                    yield "  - %s" % finding
            for line in self.mappings.get(d["name"], "").splitlines():
                yield "  | " + line
        if self.layout:
            yield self.layout

    def to_frame(self) -> "pandas.DataFrame":
        """A row for each run: duration, usable [s], number and rate [Hz] of poses, noise of positions [m]
        and headings [rad], and what is odd; units in attrs["units"]."""
        import pandas

        units = {"duration": "s", "usable": "s", "poses": "1", "rate": "Hz"}
        units.update(position_noise="m", heading_noise="rad")
        rows = []
        for d in self.runs:
            poses, noise = d["poses"], d["poses"]["noise"]
            numbers = poses["count"], poses["rate"], noise["position"], noise["heading"]
            odd = "; ".join(findings.findings(d))
            rows.append([d["duration"], d["usable"]["duration"], *numbers, odd])
        index = pandas.Index([d["name"] for d in self.runs], name="run")
        return with_units(pandas.DataFrame(rows, index=index, columns=[*units, "odd"]), units)

    def to_dict(self) -> List[Document]:
        """Plain values, as `identify info --json` prints them."""
        return self.runs


def info(recordings: Recordings, model: Optional[ModelLike] = None, progress: Progress = None) -> Info:
    """Reports contents, anomalies and usable parts of recordings.

    Parameters
    ----------
    recordings : Recording, path, or iterable of them
        Runs; with options of reading, those that `read` returns.
    model : Model or path, optional
        A model of the craft: finds from the motion which channel drives which of its thrusters.
    progress : callable or Work, optional
        Called with a Report when a stage begins, or a part of it is done.

    Returns
    -------
    Info
        Prints as the report of `identify info`.

    Raises
    ------
    GroundError
        When a recording cannot be read, or there is none.

    Examples
    --------
    >>> print(ground.info(bag).title)
    Usable: 20.1 of 22.0 s in 1 recording.
    """
    given, work = taken(recordings), Work.of(progress)
    if not given:
        raise GroundError(NO_RECORDING)
    return _looked_at(given, Model.of(model).core if model else None, work)


def _looked_at(
    given: Sequence[Recording],
    model: Optional[_core.Model],
    work: Work,
    read: Sequence[str] = (),
    named: Optional[str] = None,
) -> Info:
    """The Info of recordings. read: the arguments that name them; named: the file of the model."""
    if model:
        given = [recording.with_lift_of(model) for recording in given]
    runs = repaired(given, work)
    recordings = [run.recording for run in runs]
    doubts = suspicions.about(recordings, model) + [one for run in runs for one in suspicions.changed(run)]
    described, layout, is_open = findings.describe(runs, doubts), "", False
    angles = [str(one["channel"]) for one in model.thrusters if one["is_angle"]] if model else []
    if angles:
        text = "which channel drives which thruster is not judged: a thruster's effect changes with %s"
        layout = text % ", ".join(angles)
    elif model:
        with work.stage("judging which channel drives which thruster"):
            thrusters = layouts.thrusters_of(model)
            verdict = layouts.judge(recordings, thrusters)
            verdict = imitations.confirmed(verdict, recordings, thrusters, model)
        layout, is_open = layouts.sentence(verdict), verdict.is_open
        described = [dict(d, layout=verdict.describe()) for d in described]
    shared = tuple(one.sentence for one in doubts if len(one.runs) > 1)
    mappings = {recording.name: recording.mapping for recording in recordings}
    return Info(described, shared, mappings, layout, tuple(read), shlex.quote(named or "MODEL"), is_open)


def _worst(d: Document) -> List[str]:
    """What of a run has to be looked at before it is used, in sentences."""
    grave = CAME_LATE, NOT_SECONDS, mapping.UNDECIDED
    return [*findings.grave(d), *(w for w in d["warnings"] if any(said in w for said in grave))]


def run(arguments: argparse.Namespace) -> List[Dict[str, object]]:
    """Runs the verb; returns what --json prints."""
    if arguments.output:
        return _write_mapping(arguments)
    model = Model.load(arguments.model).core if arguments.model else None
    given, read = list(bag_arguments.read(arguments)), bag_arguments.typed(arguments)
    found = _looked_at(given, model, arguments.work, read, arguments.model)
    for line in found.lines():
        command_line.say(arguments, line)
    return found.to_dict()


def _from(mapping_file: str, path: str) -> str:
    """A path as a mapping file beside it names it."""
    folder = os.path.dirname(os.path.abspath(mapping_file))
    return path if os.path.isabs(path) else os.path.relpath(path, folder)


def _write_mapping(arguments: argparse.Namespace) -> List[Dict[str, object]]:
    """Drafts a mapping file."""
    path, output = arguments.bags[0], arguments.output
    files.refuse_existing(output, arguments.force)
    with arguments.work.stage("drafting"):
        path = recorded_files.to_draft(recorded_files.listed([path])[0])
        types = bag_arguments.mapping_of(arguments).types
        with readers.opened(path, types) as source:
            text = drafts.draft(source, os.path.isdir(path), [_from(output, one) for one in types])
    files.write_text(output, text, arguments.force)
    try:
        mapping.load(output)
        command_line.say(arguments, "%s: look through it, then give --mapping %s" % (output, output))
    except GroundError as error:
        command_line.say(arguments, "%s: a draft to complete (%s)" % (output, error))
    return [{"mapping": output, "drafted_from": path}]
