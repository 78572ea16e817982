"""diagnose: which physical effect is missing in a model."""

import argparse
import os
import re
import shlex
from dataclasses import dataclass, replace
from typing import Callable, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import diagnosis, window_error
from ground.analysis.verdict import MISREAD, conclude
from ground.data import bag_arguments, voltage
from ground.data.measured import Measured, held_out, measured
from ground.data.read import Recordings
from ground.diagnosing import answer, reporting
from ground.diagnosing.drawn import REFITTED, Drawn
from ground.diagnosing.report import DiagnosisReport, Mistake, NextExperiment
from ground.diagnosing.result import Diagnosis, prepare
from ground.effect_library import candidates
from ground.effect_library.effects import Effect, EffectLike
from ground.models import Model, ModelLike, Room, RoomLike, fitted_model
from ground.reading.recording import Recording
from ground.reports import result_folder
from ground.support import command_line
from ground.support.annotations import Array, Document
from ground.support.command_line import option
from ground.support.errors import GroundError, OptionError, did_you_mean, warn
from ground.support.headline import formatted
from ground.support.progress import Progress, Work


@dataclass(frozen=True)
class DiagnoseOptions(bag_arguments.AsRecorded, bag_arguments.Part):
    """Which effects are searched for."""

    only: Optional[Sequence[str]] = option(
        None,
        "effects of the library to try, besides those in --effects (all but %s)"
        % ", ".join(candidates.on_request()),
        metavar="EFFECT",
        nargs="+",
    )
    exclude: Sequence[str] = option((), "effects not to try", metavar="EFFECT", nargs="+")
    effects: Sequence[EffectLike] = option(
        (),
        "further effects to try: your own, one per FILE.yaml, as in model files, or names of "
        "library effects that are not tried by default (%s)" % ", ".join(candidates.on_request()),
        metavar="EFFECT",
        nargs="+",
    )
    matters: Optional[str] = option(
        None,
        "smallest change of a predicted pose that matters, such as 2mm,0.5deg (five times the pose noise)",
        metavar="MM,DEG",
    )
    room: Optional[RoomLike] = option(
        None,
        "room of the next experiment (the first one recorded with a run, else 4 x 4 m)",
        metavar="ROOM.yaml",
    )


@command_line.takes(DiagnoseOptions)
def diagnose(
    model: ModelLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    told: Optional[Callable[[str], None]] = None,
    tried: Optional[Callable[[List[Document]], None]] = None,
    progress: Progress = None,
    options: DiagnoseOptions,
) -> Diagnosis:
    """Finds the physical effects that are missing in a model, with evidence.

    Parameters
    ----------
    model : Model or path
        The model to diagnose.
    holdout : Recording, path, or several, optional
        Recordings that test the result and do not influence it. Without them, parts of the recordings
        are held out.
    told : callable, optional
        Called with each line of the verdict as soon as it is known.
    tried : callable, optional
        Called during the search, whenever more is known about single effects, with dictionaries as in
        `Diagnosis.tried`, the best first, which also contain `prediction`, the errors of poses predicted with
        the effect. An exception that the callable raises ends the search.

    Returns
    -------
    Diagnosis
        The verdict, the effects, and the model with them.

    Raises
    ------
    GroundError
        When a file cannot be read, there is no such effect, or the recordings are too short.

    Examples
    --------
    >>> found = ground.diagnose(model_file, bag, only=["yaw_bias", "quadratic_drag"])
    >>> found.verdict, found.effects  # this craft turns by itself
    ('missing', ('yaw_bias',))
    >>> low, high = found.parameters["yaw_bias.n0"].ci95
    >>> low < 2e-5 < high  # [N m], the moment that turns it
    True
    >>> found.to_frame().loc["yaw_bias", "selected"]
    True
    """
    work, matters = Work.of(progress), _what_matters(options.matters)
    given, own = Model.of(model), [Effect.of(effect) for effect in options.effects]
    to_try = effects_to_try(given, options.only, options.exclude, own)
    room = None if options.room is None else Room.of(options.room)
    seen = measured(recordings, given, options, work)
    given = voltage.at_recorded(given, seen.recordings)
    to_try = voltage.tried(to_try, given, seen.recordings, options.only or (), options.exclude)
    held = held_out(holdout, given, options, work, seen)
    if not given.core.is_pair and not any((run.lift > 0).any() for run in seen.recordings):
        if not options.only:
            to_try = [c for c in to_try if c.name not in candidates.of_lift()]
        _note_boat(given)
    flown = _first_with("room", seen)
    walls = room or (Room.of_recording(flown) if flown else None)
    noted = [
        Mistake(one.kind, one.evidence, one.remedy, list(one.runs), one.misread)
        for one in seen.findings + held.findings
    ]

    def tested(found: diagnosis.StepwiseDiagnosis) -> None:
        if tried:
            rows = reporting.screened(found)
            tried([answer.tried(row, len(rows), {}) for row in rows])

    def begun() -> diagnosis.StepwiseDiagnosis:
        """The model as it is, refitted."""
        return diagnosis.StepwiseDiagnosis(
            seen.data, given.core, to_try, work=work, matters=matters, tested=tested
        )

    found = begun()
    misread = not options.as_recorded and any(one.misread for one in noted)
    if not misread:
        found.grow()
        is_turned = not options.as_recorded and any(one.kind == "offset" for one in noted)
        if is_turned and "heading_offset" not in found.model.effects:
            # The search has not found what the commands show: what it found instead is not physics.
            found, misread = begun(), True
    conclusion = conclude(found, held.data, misread)
    chosen = [("only", options.only), ("all but", options.exclude)]
    selection = "; ".join("%s %s" % (which, ", ".join(names)) for which, names in chosen if names)
    report = reporting.begun(found, conclusion, given.path or given.name, held.data, noted, selection)
    if told:
        for line in formatted(answer.known_first(report)):
            told(line)
    report, planned = reporting.completed(report, found, conclusion, walls.core if walls else None)
    if planned:
        report = replace(report, next_experiment=_flown(planned.experiment, seen, room))
    improved = given
    if conclusion.verdict != MISREAD:
        before, after = (
            {"fit": float(one.error.sum()), "heldout": float(one.heldout.sum())}
            for one in (conclusion.before, conclusion.after)
        )
        parameters = {name: p.named(name) for name, p in report.improved.parameters.items()}
        pushed = _with_disturbance(conclusion.improved, report)
        improved = fitted_model(pushed, seen.recordings, before, after, parameters)
    from ground.checks import findings

    read = [run.path for run in seen.recordings + held.recordings]
    read += [given.path, *(effect.path for effect in own)]
    models = {REFITTED: conclusion.before.model}
    if found.chosen:
        models["improved"] = conclusion.improved
    drawn = Drawn(
        runs=found.runs,
        held=held.data,
        models=models,
        likeliest=found.nominal.model,
        bands=conclusion.bands,
        described=findings.describe(seen.runs + held.runs),
        inputs=[path for path in read if path],
    )
    return Diagnosis.of(report, improved, planned and planned.rows, drawn)


def _with_disturbance(model: _core.Model, report: DiagnosisReport) -> _core.Model:
    """The improved model with the random disturbance of the runs, where this is what it leaves."""
    is_known = report.verdict in ("complete", "missing", "varies") and not report.changes
    if not (is_known and report.agreement.holds and report.agreement.is_pushed):
        return model
    found = model.copy()
    found.disturbance = window_error.disturbance_of(report.disturbance, bool(report.varies))
    return found


def _what_matters(text: Optional[str]) -> Optional[Array]:
    """The option `matters`, "2mm,0.5deg": a position [mm] and a heading [deg], (2,)."""
    if text is None:
        return None
    number = r"\s*(\d+\.?\d*|\.\d+)\s*"
    found = re.fullmatch("%smm\\s*,%sdeg\\s*" % (number, number), text)
    values = np.array(found.groups() if found else [0.0], float)
    if not values.min() > 0:
        raise OptionError(
            "{0}: {given!r} is not a position and a heading; write, for example, 2mm,0.5deg",
            "matters",
            given=text,
        )
    return values


def _note_boat(model: Model) -> None:
    """Warns where a craft without a lift fan may be a boat whose model does not say so."""
    reversible = any(one["range"][0] < 0 and not one["is_angle"] for one in model.core.thrusters)
    if reversible and not model.core.hull_length > 0:
        warn(
            "%s has propellers that reverse, and no lift fan: if it floats, write 'hull: {length: METRES}' "
            "under 'body' in its model, and effects of hulls are also tried" % model.name
        )


def _first_with(file: str, seen: Measured) -> Optional[Recording]:
    """The first run that has a file: its `room`, or the `truth`, the model of a simulated craft."""
    return next((run for run in seen.recordings if file in run.files), None)


def effects_to_try(
    model: Model,
    only: Optional[Sequence[str]] = None,
    exclude: Sequence[str] = (),
    effects: Sequence[EffectLike] = (),
) -> List[candidates.Candidate]:
    """Effects of the library and of `effects`, selected by `only` and `exclude`. The ones in `effects`
    are tried in addition to the library's in `only`, unless `only` names one of them; they replace
    effects of the library with the same names. GroundError when one does not exist or does not fit
    the model."""
    given = [Effect.of(effect) for effect in effects]
    own = [effect.candidate(model.core) for effect in given]
    names = [c.name for c in own]
    library = [c for c in candidates.library(model.core, only or ()) if c.name not in names]
    by_default = [c.name for c in library] + names + list(model.effects)
    known = list(dict.fromkeys([*by_default, *candidates.effects()]))
    for name in [*(only or ()), *exclude]:
        if name not in known:
            hint = did_you_mean(name, known) or "; there are " + ", ".join(known)
            raise GroundError("there is no effect %s%s" % (name, hint))
    for effect, name in zip(given, names):
        if names.count(name) > 1:
            raise GroundError("%s: another effect %s is given" % (effect.path or name, name))
    wanted = set(by_default if only is None else only)
    if not wanted & set(names):
        wanted |= set(names)
    chosen = [c for c in library + own if c.name in wanted and c.name not in exclude]
    if not chosen:
        raise GroundError("no effect is left to try")
    for candidate in chosen:
        candidate.add(model.core)  # raises before long work starts if it does not fit the model
    return chosen


def _flown(proposed: NextExperiment, seen: Measured, room: Optional[Room]) -> NextExperiment:
    """The experiment with the room in its command line. Where the craft was a simulated one, the simulator
    flies it."""
    in_room, simulated = _first_with("room", seen), _first_with("truth", seen)
    file = room.path if room else ""
    file = file or (str(in_room.files["room"].place()) if in_room else "")
    at = shlex.quote(os.path.abspath(file)) if file else ""
    if simulated is None:
        return replace(proposed, launch=proposed.launch + (" room:=" + at if at else ""))
    from ground.diagnosing.next_experiment import IN_ROOM

    truth, arguments = shlex.quote(simulated.files["truth"].place()), proposed.arguments
    options = "%s --duration %g" % (arguments, IN_ROOM) + (" --room " + at if at else "")
    program = "rosrun ground identify simulate --model %s %s -o next.bag"
    lift = arguments.partition("--lift ")[2] or "1"
    call = "ground.simulate(CRAFT, inputs=diagnosis.next_inputs, lift=%s)" % lift
    return replace(proposed, launch=program % (truth, options), call=call)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify diagnose."""
    parser.epilog = "effects of the library: " + ", ".join(candidates.effects())
    bag_arguments.add_bag_arguments(parser)
    command_line.add_model(parser, "the model to diagnose")
    command_line.add_output(parser, "DIR", "folder for results")
    bag_arguments.add_holdout_argument(parser)
    command_line.add_options(parser, DiagnoseOptions)
    command_line.add_details(parser)
    command_line.add_mat(parser)


def run(arguments: argparse.Namespace) -> Document:
    """Runs identify diagnose; returns what --json prints."""

    def say(line: str) -> None:
        command_line.say(arguments, bag_arguments.with_bags(arguments, line))

    command_line.check_mat(arguments)
    with result_folder.kept_if_used(arguments.output):
        prepare(arguments.output, arguments.force)
        found = diagnose(
            arguments.model,
            bag_arguments.reading(arguments, arguments.bags),
            holdout=bag_arguments.reading(arguments, arguments.holdout),
            told=say,
            options=command_line.options(arguments, DiagnoseOptions),
            progress=arguments.work,
        )
    for line in formatted(answer.known_last(found.contents, arguments.output)):
        say(line)
    command_line.say_details(arguments, found.details())
    with arguments.work.stage(result_folder.WRITING):
        found.save(arguments.output, arguments.force)
    command_line.write_mat(arguments, found)
    return found.to_dict()
