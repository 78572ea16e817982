"""diagnose: which physical effect is missing in a model."""

import math
import os
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING, Callable, Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core, workers
from ground.analysis import candidates, diagnosis, diagnosis_report, stages, window_error
from ground.analysis.verdict import MISREAD, Conclusion, conclude
from ground.annotations import Array, Document, Path
from ground.api.models import (
    Model,
    ModelLike,
    Parameter,
    Room,
    RoomLike,
    fitted_model,
    parameter_rows,
    parameters_by_name,
)
from ground.api.recordings import Measured, Part, Recordings, held_out, measured
from ground.api.values import Row, Shown, number
from ground.errors import GroundError
from ground.progress import Progress, Work
from ground.recordings.recording import Recording
from ground.reports import words

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Which effects are missing in a model, by how much they improve it, and the model with them."""

    verdict: str  #: complete, missing, varies, memory, unexplained, undecided or misread
    effects: Tuple[str, ...]  #: effects that were added, in the order in which the error falls
    improved: Model  #: the model with them, refitted
    parameters: Dict[str, Parameter]  #: its parameters, by name
    error: Tuple[
        float, ...
    ]  #: held-out error of the best refit without the effects, then after each effect
    noise_floor: float  #: error there that the noise of the poses alone would leave
    next_inputs: Optional[Array]  #: (n, 3) time [s], left, right: the proposed experiment
    report: Document  #: everything, as diagnosis.json has it
    problem: "Problem"  #: what was diagnosed
    found: diagnosis.Diagnosis  #: the search, for the page
    conclusion: Conclusion

    @property
    def sentences(self) -> List[str]:
        """What `identify diagnose` prints."""
        return list(words.diagnosis(self.report))

    def to_dict(self) -> Document:
        """Plain values, as diagnosis.json has them."""
        return self.report

    def to_frame(self) -> "pandas.DataFrame":
        """The effects tried, best first, indexed by name: p_value, delta_bic, error_fit,
        error_heldout, selected, seen."""
        import pandas

        rows = self.report["candidates"]
        columns = ["p_value", "delta_bic", "selected", "seen"]
        index = pandas.Index([row["effect"] for row in rows], name="effect")
        frame = pandas.DataFrame([[row[c] for c in columns] for row in rows], index, columns)
        for place, kind in enumerate(("fit", "heldout"), 2):
            errors = [row["error"][kind] for row in rows]
            frame.insert(place, "error_" + kind, pandas.array(errors, dtype="Float64"))
        return frame

    def save(self, folder: Path, force: bool = False) -> List[str]:
        """Writes diagnosis.json, improved.yaml, the page report.html and, where there are any,
        proposal.yaml and next_experiment.csv. Returns their paths. GroundError when a file cannot be
        written, or exists and `force` is not set."""
        from ground.reports import diagnosis_files

        kept = diagnosis_files.Folder(os.fspath(folder), force)
        kept.prepare()
        kept.write_numbers(self)
        kept.write_page(self)
        return kept.written

    def _table(self) -> Tuple[str, Row, List[Row]]:
        title = "%s (error on held-out runs %s, noise of the poses alone %s)" % (
            words.verdict(self.report),
            " -> ".join(map(number, self.error)),
            number(self.noise_floor),
        )
        head = ["parameter", "improved", "95% interval", "unit"]
        return title, head, parameter_rows(self.parameters)


@dataclass(frozen=True)
class Problem:
    """What is diagnosed."""

    model: Model
    tried: List[candidates.Candidate]
    seen: Measured  #: recordings to fit to
    held: Measured  #: recordings to test on; empty: parts of `seen` are held out
    own: List[str]  #: files of effects
    budget: Optional[int]
    thorough: bool
    given_room: Optional[Room]
    as_recorded: bool = False  #: diagnoses recordings that look misread, too

    @property
    def runs(self) -> List[_core.RunData]:
        """_core.RunData fitted to."""
        return self.seen.data

    @property
    def findings(self) -> List[Document]:
        """Mistakes that the recordings look like, as diagnosis.json has them."""
        return [finding.describe() for finding in self.seen.findings + self.held.findings]

    @property
    def misread(self) -> bool:
        """Whether effects are not looked for, because the recordings look misread."""
        return not self.as_recorded and any(finding["misread"] for finding in self.findings)

    @property
    def is_turned(self) -> bool:
        """Whether the heading looks off by a constant, which is an effect of the library, too."""
        return not self.as_recorded and any(f["kind"] == "offset" for f in self.findings)

    @property
    def inputs(self) -> List[str]:
        """Paths of all that was read."""
        bags = [r.path for r in self.seen.recordings + self.held.recordings]
        return [path for path in [*bags, self.model.path, *self.own] if path]

    def flown_in(self) -> Optional[Recording]:
        """The first run that a room was kept with."""
        return next((r for r in self.seen.recordings if "room" in r.files), None)

    def room(self) -> Optional[Room]:
        """Where the next experiment has to stay; None if no room is known."""
        flown = self.flown_in()
        return self.given_room or (Room.of_recording(flown) if flown else None)

    def room_file(self) -> str:
        """A file of that room; empty without one."""
        flown = self.flown_in()
        if self.given_room:
            return self.given_room.path
        return str(flown.files["room"].place()) if flown else ""


def diagnose(
    model: ModelLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    only: Optional[Sequence[str]] = None,
    exclude: Sequence[str] = (),
    effects: Sequence[Path] = (),
    budget: Optional[int] = None,
    thorough: bool = False,
    room: Optional[RoomLike] = None,
    start: float = 0.0,
    end: Optional[float] = None,
    everything: bool = False,
    as_recorded: bool = False,
    scheduler: Optional[str] = None,
    progress: Progress = None,
) -> Diagnosis:
    """Which physical effects are missing in a model, with evidence, and the model with them.

    recordings, holdout: recordings or bags to fit to and to test on; holdout judges what is found
    and decides nothing. Without it, parts of recordings are held out. only, exclude: names of
    effects to try and not to try (by default all of the library, except those that are tried on
    request). effects: further effects to try, as names or as YAML files with one effect each.
    budget: number of effects that are refitted in each step, best by a score test first. thorough:
    uses all of long recordings. room: for the next experiment. start, end: the part of every run,
    on the run's clock [s]; everything: includes parts that are not usable. as_recorded: diagnoses
    recordings that look misread (swapped channels, wrong signs, units or clocks), too; otherwise
    the verdict says so and no effect is blamed. scheduler: of a Dask cluster that does the fits, as for
    `compare`. progress: called with a ground.progress.Report at each step. GroundError when a file
    cannot be read, there is no such effect or the recordings are too short.

    >>> found = ground.diagnose(model_file, bag, only=["yaw_bias", "quadratic_drag"])
    >>> found.verdict, found.effects  # this craft turns by itself
    ('missing', ('yaw_bias',))
    >>> low, high = found.parameters["yaw_bias.n0"].ci95
    >>> low < 2e-5 < high  # [N m], the moment that turns it
    True
    >>> found.to_frame().loc["yaw_bias", "selected"]
    True
    """
    work = Work.of(progress)
    problem = read_problem(
        model,
        recordings,
        holdout,
        chosen=(only, exclude, effects),
        budget=budget,
        thorough=thorough,
        room=room,
        part=Part(start, end, everything),
        work=work,
        as_recorded=as_recorded,
    )
    with workers.Workers(scheduler) as team:
        return solve(problem, work, team)


def read_problem(
    model: ModelLike,
    recordings: Recordings,
    holdout: Recordings,
    chosen: Tuple[Optional[Sequence[str]], Sequence[str], Sequence[Path]],
    budget: Optional[int],
    thorough: bool,
    room: Optional[RoomLike],
    part: Part,
    work: Work,
    as_recorded: bool = False,
) -> Problem:
    """Reads all that a diagnosis needs; chosen: only, exclude and effects of `diagnose`;
    work: told of what is done."""
    given = Model.of(model)
    only, exclude, effects = chosen
    own = [os.fspath(effect) for effect in effects]
    tried = effects_to_try(given, only, exclude, own)
    given_room = None if room is None else Room.of(room)
    work.expect(stages.SEARCHING, None)
    seen = measured(recordings, given, part, work)
    held = held_out(holdout, given, part, work, seen)
    files = [effect for effect in own if effect not in candidates.on_request()]
    return Problem(given, tried, seen, held, files, budget, thorough, given_room, as_recorded)


def effects_to_try(
    model: Model,
    only: Optional[Sequence[str]] = None,
    exclude: Sequence[str] = (),
    effects: Sequence[str] = (),
) -> List[candidates.Candidate]:
    """Effects of the library and of `effects`, selected by `only` and `exclude`. Those of `effects`
    are tried in addition to the library's in `only`, unless `only` names one of them; they replace
    those of the library with the same names. GroundError when one does not exist or does not fit
    the model."""
    own = [candidates.named(effect, model.core) for effect in effects]
    names = [c.name for c in own]
    library = [c for c in candidates.library(model.core, only or ()) if c.name not in names]
    by_default = [c.name for c in library] + names + list(model.effects)
    _check_known([*(only or ()), *exclude], by_default)
    for path, name in zip(effects, names):
        if names.count(name) > 1:
            raise GroundError("%s: --effects has another effect %s" % (path, name))
    wanted = set(only or by_default)
    if not wanted & set(names):
        wanted |= set(names)
    chosen = [c for c in library + own if c.name in wanted and c.name not in exclude]
    if not chosen:
        raise GroundError("no effect is left to try")
    for candidate in chosen:
        candidate.add(model.core)  # raises before long work starts if it does not fit the model
    return chosen


def _check_known(named: Iterable[str], by_default: List[str]) -> None:
    known = by_default + [name for name in candidates.on_request() if name not in by_default]
    for name in named:
        if name not in known:
            raise GroundError("there is no effect %s; there are %s" % (name, ", ".join(known)))


def solve(
    problem: Problem,
    work: Work,
    team: workers.Workers,
    told: Callable[[Document], None] = lambda report: None,
) -> Diagnosis:
    """Diagnoses; work: told of what is done; team: does the fits; told: called with the part of the report
    that the verdict needs, as soon as it is known."""
    room = problem.room()
    found, misread = _diagnosis(problem, work, team), problem.misread
    if not misread:
        found.grow()
        if problem.is_turned and "heading_offset" not in found.model.effects:
            # The search has not found what the commands show: what it found instead is not physics.
            found, misread = _diagnosis(problem, work, team), True
    held = problem.held.data
    conclusion = conclude(found, held, misread)
    work.note("verdict: %s" % conclusion.verdict)
    name, walls = problem.model.path or problem.model.name, room.core if room else None
    report = diagnosis_report.begun(found, conclusion, name, held, problem.findings)
    told(report)
    report = diagnosis_report.completed(report, found, conclusion, problem.thorough, walls)
    return _result(problem, found, conclusion, report)


def _diagnosis(problem: Problem, work: Work, team: workers.Workers) -> diagnosis.Diagnosis:
    """The model as it is, refitted."""
    return diagnosis.Diagnosis(
        problem.runs,
        problem.model.core,
        problem.tried,
        problem.budget,
        work=work,
        most=math.inf if problem.thorough else window_error.MAX_WINDOWS,
        each=team.map if team.is_cluster else None,
    )


def _result(
    problem: Problem,
    found: diagnosis.Diagnosis,
    conclusion: Conclusion,
    report: Document,
) -> Diagnosis:
    parameters = parameters_by_name(conclusion.parameters)
    return Diagnosis(
        verdict=conclusion.verdict,
        effects=tuple(report["improved"]["effects"]),
        improved=problem.model if conclusion.verdict == MISREAD else fitted_model(
            conclusion.improved,
            problem.seen.recordings,
            _errors(report["nominal"]["error"]),
            _errors(report["improved"]["error"]),
            parameters,
        ),
        parameters=parameters,
        error=tuple(conclusion.heldout),
        noise_floor=conclusion.heldout_floor,
        next_inputs=_next_inputs(problem, report["next_experiment"]),
        report=report,
        problem=problem,
        found=found,
        conclusion=conclusion,
    )


def _errors(error: Document) -> Dict[str, float]:
    """An error of a report, as model files keep it."""
    return {kind: error[kind] for kind in ("fit", "heldout")}


def _next_inputs(problem: Problem, proposed: Document) -> Optional[Array]:
    """Takes the inputs out of the proposal, and adds the room to its command line."""
    if not proposed:
        return None
    file = problem.room_file()
    if file:
        proposed["launch"] += " room:=%s" % shlex.quote(os.path.abspath(file))
    return np.array(proposed.pop("rows"), float)
