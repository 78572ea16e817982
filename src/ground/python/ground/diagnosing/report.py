"""What a diagnosis found: the contents of diagnosis.json, whose schema explains them
(docs/schemas/diagnosis.schema.json)."""

import math
from dataclasses import dataclass, field
from typing import Dict, List, NamedTuple, Optional, Tuple

from ground.analysis.agreement import Agreement
from ground.analysis.bands import Coverage
from ground.analysis.horizon import PoseError, PredictionChange, PredictionError
from ground.analysis.judge import PairedComparison
from ground.analysis.verdict import MISREAD, Varying
from ground.models import Parameter
from ground.reports import result_folder
from ground.support import records
from ground.support.annotations import Array, Document, Path
from ground.support.records import ABSENT, NULL

SCHEMA = "ground/diagnosis/1"
INFINITE = {NULL: math.inf}
OPEN_ENDS = {NULL: (-math.inf, math.inf)}  # of an interval
LEFT_OUT: Dict[str, object] = {ABSENT: None}


@dataclass(frozen=True)
class RunNames:
    """Names of the runs."""

    fit: List[str]
    heldout: List[str]  # by the user; without any, those fitted to
    inertial: List[str] = field(metadata={ABSENT: []})  # with a gyro and an accelerometer

    @property
    def is_held_out(self) -> bool:
        """Whether the user held out runs."""
        return self.heldout != self.fit


@dataclass(frozen=True)
class Extent:
    """How much of the data was used."""

    used: float
    available: float


@dataclass(frozen=True)
class Mistake:
    """A mistake that recordings look like."""

    kind: str
    evidence: str
    remedy: str
    runs: List[str]
    misread: bool

    @property
    def sentence(self) -> str:
        """In words."""
        from ground.checks.suspicions import Suspicion

        return Suspicion(self.kind, self.evidence, self.remedy, tuple(self.runs)).sentence


@dataclass(frozen=True)
class ModelError:
    """Errors of a model on runs fitted to and on runs held out; None: not known."""

    fit: Optional[float]
    heldout: Optional[float]
    by: str  # cross-validation: parts of the runs, each by a fit to the others; holdout: runs of the user


@dataclass(frozen=True)
class ReportedParameter:
    """A parameter of a model or of an effect."""

    value: float = field(metadata=INFINITE)
    unit: str
    ci95: Tuple[float, float] = field(metadata=OPEN_ENDS)
    identified: bool
    start: Optional[float] = field(metadata={**LEFT_OUT, **INFINITE})  # in the given model, if it is there
    deviation: Optional[float] = field(metadata={ABSENT: None, NULL: math.nan})
    at_bound: Optional[bool] = field(metadata=LEFT_OUT)
    # where runs do not agree, the least and the largest value of single ones
    runs: Optional[Tuple[float, float]] = field(metadata={**LEFT_OUT, **OPEN_ENDS})

    def named(self, name: str) -> Parameter:
        """The parameter as results have it."""
        start, deviation = (math.nan if one is None else one for one in (self.start, self.deviation))
        flags = bool(self.at_bound), self.identified
        return Parameter(name, self.unit, start, self.value, self.ci95, deviation, *flags, self.runs)


Parameters = Dict[str, ReportedParameter]


@dataclass(frozen=True)
class Nominal:
    """The best refit without further effects."""

    parameters: Parameters
    error: ModelError
    cross_validated: float
    by: str = ""  # likelihood or simulation; reports of release 1.0.0 do not say it


@dataclass(frozen=True)
class FitLikelihood:
    """The log-likelihood of a fit, and what information criteria need."""

    llf: float
    parameters: int
    observations: int


@dataclass(frozen=True)
class Improved:
    """The model with the effects found."""

    effects: List[str]
    parameters: Parameters
    error: ModelError
    cross_validated: float
    by: str = ""
    likelihood: Optional[FitLikelihood] = field(default=None, metadata=LEFT_OUT)


@dataclass(frozen=True)
class EffectTests:
    """The model with an effect compared with the model without it, on data that neither was fitted to."""

    fitted: PairedComparison  # parts of the runs fitted to
    holdout: Optional[PairedComparison]  # the runs that the user held out


@dataclass(frozen=True)
class AddedEffect:
    """An effect that was added."""

    added: str
    error: ModelError  # of the model with the proposed effect
    group: List[str]  # effects that the runs do not distinguish from it, itself first
    p: float
    p_corrected: float  # for the number of effects tried
    judged: EffectTests
    p_interval: float = 0.0  # that it is nothing, by its interval

    @property
    def others(self) -> List[str]:
        """What the runs do not distinguish from it."""
        return [name for name in self.group if name != self.added]


@dataclass(frozen=True)
class DroppedEffect:
    """An effect that the likelihood prefers and that was not added."""

    effect: str
    parameters: Parameters
    why: str
    p: float
    p_corrected: float
    change: Optional[PredictionChange]  # of predicted poses, where it is too small to matter


@dataclass(frozen=True)
class ScreenedEffect:
    """A single effect while the search goes on."""

    effect: str
    parameters: Parameters
    p: float
    p_corrected: float
    delta_bic: float
    prediction: Optional[PoseError]  # with it, refitted by likelihood
    given: Optional[PoseError]  # of the given model


@dataclass(frozen=True)
class TriedEffect:
    """A single effect added to the refitted model."""

    effect: str
    parameters: Parameters
    rank: int
    p: float
    p_corrected: float
    delta_bic: float
    error: ModelError
    selected: bool
    group: List[str]  # effects that the runs do not distinguish from it, itself first
    seen: bool  # whether the runs can show it

    @property
    def others(self) -> List[str]:
        """What the runs do not distinguish from it."""
        return [name for name in self.group if name != self.effect]


@dataclass(frozen=True)
class ErrorShare:
    """Part of the squared error, with its 95% interval."""

    share: float
    ci95: Tuple[float, float]


@dataclass(frozen=True)
class ErrorShares:
    """What the effects found explain of the error, what further ones could, and what is chance."""

    named: ErrorShare
    learnable: ErrorShare
    chance: ErrorShare
    bound: float  # largest part of what is left that the data allow a function of one kind
    said: bool  # whether something learnable is left
    arguments: Dict[str, float]  # part of the learnable that is lost without each argument, largest first
    terms: List[str]  # functions that were found
    named_as: Optional[str]  # the proposal in words


@dataclass(frozen=True)
class NextExperiment:
    """The experiment in which rivals would diverge most."""

    separates: List[str]  # names of the rivals
    input: str  # in words
    arguments: str  # of `identify simulate`, which flies it open loop
    launch: str  # line that flies it
    room: str  # its name
    repeat: int  # number of such runs for a clear decision
    expected_disagreement: float  # of one such run [standard deviations]
    call: str = field(default="", metadata={ABSENT: ""})  # that flies a simulated craft in Python


class Planned(NamedTuple):
    """An experiment with its design."""

    experiment: NextExperiment
    rows: Array  # (n, 3) time [s], left and right


@dataclass(frozen=True)
class ArgumentShare:
    """Part of the learnable that is lost without an argument."""

    variable: str
    share: float


@dataclass(frozen=True)
class ProposedParameter:
    """A parameter of a proposal, as model files list it."""

    unit: str
    value: float
    neutral: float
    scale: float
    lower: float
    upper: float


@dataclass(frozen=True)
class ProposedEffect:
    """A formula for what has no name: an effect as model files list it, with its meaning and its error."""

    name: str
    states: Dict[str, str] = field(metadata={ABSENT: {}})
    expression: Dict[str, str]
    parameters: Dict[str, ProposedParameter]
    means: str
    error: ModelError

    @property
    def entry(self) -> Document:
        """The effect as model files list it."""
        return {key: value for key, value in records.plain(self).items() if key not in ("means", "error")}


@dataclass(frozen=True)
class Unexplained:
    """What the error depends on where something has no name, and an effect that would lower it."""

    where: List[ArgumentShare]
    proposal: Optional[ProposedEffect]


@dataclass(frozen=True)
class DiagnosisReport:
    """All that a diagnosis found."""

    schema: str
    version: str = field(metadata={ABSENT: ""})
    model: str  # its file, or its name
    means: Dict[str, str]  # effects in words
    runs: RunNames
    windows: Extent  # number of them
    seconds: Optional[Extent]  # reports of release 1.0.0 have none
    verdict: str
    findings: List[Mistake]
    selection: str = field(metadata={ABSENT: ""})  # which effects were tried; empty: all
    nominal: Nominal
    improved: Improved
    noise_floor: float
    prediction: Optional[PredictionError]
    matters: Optional[PoseError]  # least change that matters; reports of release 1.0.0 have none
    steps: List[AddedEffect]
    dropped: List[DroppedEffect]
    varies: List[Varying]
    ceiling: ErrorShares
    agreement: Agreement  # whether what is left is the random disturbance
    disturbance: Dict[str, float]  # levels
    candidates: List[TriedEffect]
    bands: List[Coverage]
    next_experiment: Optional[NextExperiment]
    unexplained: Unexplained

    @property
    def changes(self) -> List[Mistake]:
        """Changes of the craft during runs, so that one model cannot fit them."""
        from ground.checks.suspicions import CHANGED

        return [one for one in self.findings if one.kind == CHANGED]

    @property
    def is_misread(self) -> bool:
        """Whether the recordings look misread."""
        return self.verdict == MISREAD

    @classmethod
    def load(cls, folder: Path, name: str) -> "DiagnosisReport":
        """The report in a file of a folder. GroundError when it cannot be read."""
        return records.read(cls, _renewed(result_folder.read(folder, name, SCHEMA)), name)


def _renewed(found: Document) -> Document:
    """A report as also older versions wrote it, whose `p_value` was corrected in some lists only."""
    for kind in ("candidates", "varies", "steps", "dropped"):
        for row in (row for row in found[kind] if "p_value" in row):
            p = row.pop("p_value")
            if kind in ("candidates", "varies"):
                row.update(p=None, p_corrected=p)
            else:
                row.update(p=p, p_corrected=corrected(p, len(found["candidates"])))
    return found


def corrected(p: float, tried: int) -> float:
    """The bound of a p-value for the number of effects tried (Bonferroni)."""
    return min(1.0, tried * p)
