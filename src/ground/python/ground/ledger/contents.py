"""What a history found, as history.json has it (schema ground/history/1, which explains the keys)."""

from dataclasses import dataclass
from typing import Dict, Iterator, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis.distributions import normal_limit
from ground.effect_library.parameters import described
from ground.ledger import changes
from ground.ledger.analysed import CHANCE, Analysed, Ends, Odd
from ground.ledger.changes import ParameterChange
from ground.ledger.estimates import RecordedRun
from ground.ledger.finding import Place
from ground.ledger.verdicts import SavedVerdict

SCHEMA = "ground/history/1"
WIDE = 2.0  # half length of an interval, in a parameter's size, from which a run tells nothing of use
SEEN = 1e-3  # least scatter that is reported, in a parameter's size
NORMAL = normal_limit(0.025)


@dataclass(frozen=True)
class FollowedParameter:
    """A parameter of a type of craft, and how it scatters."""

    unit: str
    means: str
    relative: bool  #: whether the scatters are shares
    size: float  #: at the crafts in the middle
    run_scatter: float  #: standard deviation from run to run of a day; 0: none seen
    day_scatter: float  #: ... from day to day
    days_repeat: bool  #: whether days can be distinguished from runs


@dataclass(frozen=True)
class CraftType:
    """A type of craft: its model and the parameters that are followed."""

    name: str
    file: str  #: of the model; empty: recorded with the runs
    text: str
    parameters: Dict[str, FollowedParameter]


@dataclass(frozen=True)
class LevelValue:
    """A parameter of a craft."""

    value: float
    ci95: Ends


@dataclass(frozen=True)
class RunValue(LevelValue):
    """A parameter of a run."""

    mean: Optional[float]  #: of the craft at this run, with its drift and jumps


@dataclass(frozen=True)
class CraftNow:
    """A craft after all changes."""

    name: str
    type: str
    runs: int
    days: int
    first: str  #: ISO 8601, local time
    last: str
    now: Dict[str, Optional[LevelValue]]  #: None: not known


@dataclass(frozen=True)
class CraftFinding:
    """What is found of a parameter of a craft."""

    craft: str
    type: str
    parameter: str


@dataclass(frozen=True)
class FoundChange(CraftFinding):
    """A drift or a jump of a parameter of a craft."""

    kind: str  #: "drift" or "jump"
    before: float
    after: float
    after_ci95: Ends
    between: List[str]  #: names of the runs before and after a jump, or of the first and the last run
    times: List[str]  #: when these were recorded
    runs: int  #: of the craft that tell something about the parameter
    p_value: float  #: corrected for the number of parameters and crafts


@dataclass(frozen=True)
class OddCraft(CraftFinding):
    """A craft that differs from the others of its type."""

    value: float
    ci95: Ends
    others: Dict[str, float]
    either: bool  #: there are two crafts only: either may be the odd one


@dataclass(frozen=True)
class RunEntry:
    """A run and its estimates."""

    name: str
    path: str
    recorded: str  #: ISO 8601, local time
    time_from: str  #: "stamps", "name" or "file"
    length: float  #: of what was used [s]
    craft: str
    type: str
    parameters: Dict[str, Optional[RunValue]]  #: None: the run does not identify it


@dataclass(frozen=True)
class LeftOut:
    """A file that could not be used."""

    path: str
    why: str

    @classmethod
    def of(cls, path: str, why: str) -> "LeftOut":
        """With a reason that may begin with the path."""
        return cls(path, why.replace(path + ": ", ""))


@dataclass(frozen=True)
class HistoryContents:
    """All that a history found."""

    schema: str
    version: str
    folders: List[str]
    crafts_by: str  #: "model", "folder" or "pattern"
    types: List[CraftType]
    crafts: List[CraftNow]
    changes: List[FoundChange]  #: the most certain first
    odd: List[OddCraft]
    runs: List[RunEntry]  #: in order of time, by type
    left_out: List[LeftOut]
    verdicts: List[SavedVerdict]

    def type_of(self, name: str) -> CraftType:
        """The type of that name."""
        return next(one for one in self.types if one.name == name)

    def crafts_of(self, kind: CraftType) -> List[CraftNow]:
        """The crafts of a type."""
        return [craft for craft in self.crafts if craft.type == kind.name]


@dataclass(frozen=True)
class UsedRun:
    """A run that is used, before all are analysed together."""

    place: Place
    found: RecordedRun
    recorded: str  #: ISO 8601, local time
    time_from: str
    name: str = ""
    craft: str = ""


@dataclass(frozen=True)
class TypeHistory:
    """The runs of a type of craft, in order of time, and their analysis."""

    analysis: Analysed
    used: Sequence[UsedRun]

    @property
    def type(self) -> CraftType:
        """The model, and how its parameters scatter: standard deviations of relative size where the parameter
        has one, else in its unit."""
        found, parameters = self.analysis, {}
        known = described(found.model.core)
        for i, name in enumerate(found.free):
            factor = 1.0 if is_relative(name) else found.scale[i]
            parameters[name] = FollowedParameter(
                unit=known[name].unit,
                means=known[name].doc,
                relative=is_relative(name),
                size=abs(found.value(i, float(np.median(found.levels.mean[:, i])))),
                run_scatter=_scatter(factor, found.levels.run[i]),
                day_scatter=_scatter(factor, found.levels.day[i]),
                days_repeat=found.runs.repeated,
            )
        return CraftType(found.model.name, found.model.path, found.model.format(), parameters)

    def crafts(self) -> Iterator[CraftNow]:
        """Each craft as it is now."""
        found = self.analysis
        for number, name in enumerate(found.crafts):
            own = np.flatnonzero(found.runs.craft == number)
            deviation = np.sqrt(np.diag(found.levels.covariance[number]))
            levels: Dict[str, Optional[LevelValue]] = {}
            for i, parameter in enumerate(found.free):
                now, reach = found.levels.mean[number, i], NORMAL * deviation[i]
                value = LevelValue(*found.interval(i, now, now - reach, now + reach))
                levels[parameter] = value if reach < WIDE else None
            days = len(set(found.runs.day[own].tolist()))
            first, last = (self.used[at].recorded for at in (own[0], own[-1]))
            yield CraftNow(name, found.model.name, len(own), days, first, last, levels)

    def changes(self) -> Iterator[FoundChange]:
        """All changes, the most certain first."""
        every = [(one.chance, key, one) for key, own in self.analysis.changes.items() for one in own]
        for _, (craft, i), one in sorted(every, key=lambda entry: entry[:2]):
            yield self._change(craft, i, one)

    def _change(self, craft: int, i: int, one: ParameterChange) -> FoundChange:
        found = self.analysis
        at = found.of(craft, i)
        curve, is_jump = found.curves[at, i], one.kind == changes.JUMP
        ends = [self.used[run] for run in ((at[one.at - 1], at[one.at]) if is_jump else (at[0], at[-1]))]
        start = float(curve[one.at - 1]) if is_jump else float(curve[0])
        after, ci95 = found.interval(i, start + one.size, start + one.low, start + one.high)
        return FoundChange(
            craft=found.crafts[craft],
            type=found.model.name,
            parameter=found.free[i],
            kind=one.kind,
            before=found.value(i, start),
            after=after,
            after_ci95=ci95,
            between=[run.name for run in ends],
            times=[run.recorded for run in ends],
            runs=len(at),
            p_value=min(1.0, one.chance * CHANCE / found.level(i)),
        )

    def odd(self, one: Odd) -> OddCraft:
        """A craft that differs from the others."""
        found, i = self.analysis, one.parameter
        others = [c for c in range(len(found.crafts)) if c != one.craft]
        level = found.levels.mean[one.craft, i]
        reach = NORMAL * np.sqrt(found.levels.covariance[one.craft, i, i])
        return OddCraft(
            found.crafts[one.craft],
            found.model.name,
            found.free[i],
            *found.interval(i, level, level - reach, level + reach),
            others={found.crafts[c]: found.value(i, found.levels.mean[c, i]) for c in others},
            either=one.alone,
        )

    def runs(self) -> Iterator[RunEntry]:
        """Each run with its estimates, each parameter as it is when the others are as usual."""
        found = self.analysis
        for number, run in enumerate(self.used):
            assert run.found.estimate
            yield RunEntry(
                name=run.name,
                path=run.place.path,
                recorded=run.recorded,
                time_from=run.time_from,
                length=run.found.estimate.length,
                craft=run.craft,
                type=found.model.name,
                parameters={name: self._value(number, i) for i, name in enumerate(found.free)},
            )

    def _value(self, run: int, i: int) -> Optional[RunValue]:
        found = self.analysis
        value, mean = found.each[run, i], float(found.curves[run, i])
        reach = NORMAL / np.sqrt(max(found.known[run, i], 1e-300))
        if reach >= WIDE:
            return None
        interval = found.interval(i, value, value - reach, value + reach)
        return RunValue(*interval, mean=None if np.isnan(mean) else found.value(i, mean))


def of(
    folders: List[str],
    crafts_by: str,
    types: Sequence[TypeHistory],
    left_out: List[LeftOut],
    verdicts: List[SavedVerdict],
) -> HistoryContents:
    """The contents. types: one for each model; verdicts: of saved diagnoses."""
    return HistoryContents(
        schema=SCHEMA,
        version=_core.version,
        folders=folders,
        crafts_by=crafts_by,
        types=[kind.type for kind in types],
        crafts=[craft for kind in types for craft in kind.crafts()],
        changes=[change for kind in types for change in kind.changes()],
        odd=[kind.odd(one) for kind in types for one in kind.analysis.odd],
        runs=[run for kind in types for run in kind.runs()],
        left_out=left_out,
        verdicts=verdicts,
    )


def _scatter(factor: float, variance: float) -> float:
    """A standard deviation; zero if it is too small to matter."""
    return float(factor * np.sqrt(variance)) if variance > SEEN**2 else 0.0


def is_relative(parameter: str) -> bool:
    """Whether differences of a parameter are in percent: parameters of the body, which are never zero."""
    return "." not in parameter
