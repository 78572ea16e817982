"""What the flights so far have shown: a diagnosis of all of them, and what it leaves open."""

from dataclasses import dataclass, field
from typing import Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import diagnosis, formula_words, horizon, naming, window_error, windows
from ground.analysis.horizon import PoseError
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.verdict import Conclusion, conclude
from ground.checks import suspicions
from ground.checks.quality import repaired
from ground.discovery import beliefs, information, pieces
from ground.discovery.beliefs import State
from ground.discovery.information import Offer, Question
from ground.discovery.story import Off
from ground.effect_library import candidates
from ground.reading.recording import Recording
from ground.reports import effect_words
from ground.reports.words import prediction
from ground.support.annotations import Document
from ground.support.errors import Diverged
from ground.support.progress import Work

# Expected before the first flight: noise of the poses and random wrench
NOISE = np.array([3e-4, 3e-4, 5e-3])  # [m], [m], [rad]
DISTURBANCE = 0.05  # relative to the level that fits start from
MAX_NOISE_RATIO = 1.5  # ratio of the error to the noise of poses from which what is left has to be explained
UNDECIDED = "undecided"  # the verdict on flights that cannot decide whether something is missing
SIMULATIONS = 20  # artificial flights that give the distribution of an error


@dataclass(frozen=True)
class Proposal:
    """An effect that the library does not have."""

    entry: Document  # as model files list it
    means: str  # in words
    formula: Optional[naming.Formula] = None

    def in_words(self, model: _core.Model) -> str:
        """What it means, at the values of a model that has it."""
        name = str(self.entry["name"])
        known = self.formula is not None and name in model.effects
        return self.formula.in_words(model, name) if self.formula and known else self.means


@dataclass(frozen=True)
class FlightDiagnosis:
    """A diagnosis of all flights so far."""

    diagnosis: diagnosis.StepwiseDiagnosis
    conclusion: Conclusion
    state: State
    offers: List[Offer]  # what can be flown next
    words: Mapping[str, str] = field(default_factory=dict)  # of found and proposed effects

    @property
    def model(self) -> _core.Model:
        """The improved model."""
        return self.conclusion.improved

    @property
    def verdict(self) -> str:
        """The verdict of the conclusion."""
        return self.conclusion.verdict

    @property
    def asked(self) -> List[Question]:
        """Open questions about effects."""
        tested = self.state.questions.basis.columns
        return [q for q in self.state.open if q.rival or q.about in tested]

    @property
    def is_left_open(self) -> bool:
        """Whether something is left, or may be left that the random wrench only stands in for: the error
        is far above the noise of poses, and what is left is not shown to be chance."""
        if self.verdict not in ("complete", "missing", "varies"):
            return self.verdict == UNDECIDED
        left = self.conclusion.ceiling
        if left.said:
            return True
        is_far = float(self.diagnosis.best.error.sum()) > MAX_NOISE_RATIO * self.conclusion.noise_floor
        return is_far and (left.is_open or not self.conclusion.agreement.holds)


class Analyst:
    """Diagnoses flights of a craft, given its model before the first one. threads: 0 for all cores."""

    def __init__(self, given: _core.Model, room: _core.RoomPlan, threads: int = 0) -> None:
        self.given, self.room, self.threads = given, room, threads
        self.own: Dict[str, Proposal] = {}  # effects that were proposed on the way, by name
        self.proposals = 0  # number of formulas that were proposed
        self.depends = "depends on unmeasured quantities"  # what the last diagnosis left unexplained
        self.sizes: Dict[str, float] = {}  # those that matter, by parameter of an effect
        self._prepare()

    def _prepare(self) -> None:
        """Computes what is known before the first flight."""
        first = [
            (piece, pieces.motion(piece, self.given, self.room, NOISE))
            for piece in pieces.pieces(self.given, 1)
        ]
        self.overview = pieces.together([motion for _, motion in first])
        likelihood = Likelihood([self.overview], self.given, ())
        self.levels = dict(likelihood.box.start(self.given).levels)
        for channel in ("X", "Y", "N", "room"):
            self.levels["sigma_" + channel] *= DISTURBANCE
        basis = self.basis(self.given)
        known = information.of_runs(basis, likelihood, self.levels)
        self.measure(basis, known)
        nothing = information.Information(0 * known.matrix, 0 * known.score, known.scale)
        self.start = beliefs.before(basis, nothing, self.sizes)
        self.first_offers = [self._offer(*played, basis, self.levels) for played in first]

    def missing(self, model: _core.Model) -> List[candidates.Candidate]:
        """Effects of the library and proposed effects that a model does not have."""
        own = [self._own(name) for name in self.own if name not in model.effects]
        return candidates.library(model) + own

    def _own(self, name: str) -> candidates.Candidate:
        """An effect that was proposed."""
        return candidates.from_entry(self.own[name].entry, name, self.given)

    @property
    def formulas(self) -> Dict[str, Dict[str, str]]:
        """Formulas of the proposals, by channel of the wrench or thruster."""
        return {name: dict(p.entry["expression"]) for name, p in self.own.items()}

    def basis(self, model: _core.Model) -> information.Basis:
        """The Basis of a model and all effects that may be missing in it."""
        constants = [
            "%s.%s" % (name, parameter)
            for name, proposal in self.own.items()
            for parameter, p in proposal.entry["parameters"].items()
            if p["value"] == p["neutral"]
        ]
        return information.Basis.of(model, self.missing(model), constants)

    def measure(self, basis: information.Basis, known: information.Information) -> None:
        """Finds the sizes that matter of effects whose size is not known yet."""
        if not all(name in self.sizes for name in basis.names[len(basis.free) :]):
            missing = self.missing(basis.model)
            found = information.sizes_that_matter(basis, missing, self.overview, known)
            self.sizes = {**found, **self.sizes}

    def misread(self, recordings: Sequence[Recording]) -> List[str]:
        """Why recordings look misread, so that an effect found in them would not be physics; empty if
        they do not."""
        doubts = suspicions.about(recordings, self.given)
        return [doubt.sentence for doubt in doubts if doubt.misread]

    def diagnose(
        self, recordings: Sequence[Recording], reachable: float, seed: int, work: Optional[Work] = None
    ) -> FlightDiagnosis:
        """Diagnoses recordings. reachable: time that is left for flights [s]; seed: of what is offered
        for the next one; work: gets the progress. GroundError when they are too short."""
        work = work or Work()
        runs = [repaired(recording).data(self.given) for recording in recordings]
        effects = [*candidates.library(self.given), *map(self._own, self.own)]
        found = diagnosis.StepwiseDiagnosis(runs, self.given, effects, threads=self.threads, work=work)
        found.grow()
        conclusion = conclude(found)
        groups, fit, model = self._hypotheses(found, conclusion)
        basis = self.basis(model)
        known = information.of_runs(basis, found.likelihood, fit.levels, fit.loudness)
        self.measure(basis, known)
        offers = self.offers(basis, fit.levels, seed, found.likelihood.varying, work)
        later = information.mean_rate(offers) * reachable
        noise = conclusion.noise_floor / conclusion.heldout[0]
        small = {d.trial.name for d in found.dropped}
        state = beliefs.after(groups, small, basis, known, self.sizes, later, noise)
        told = [member for group in groups.values() for member in group.values if member in self.own]
        words = {name: self.own[name].in_words(model) for name in told}
        return FlightDiagnosis(found, conclusion, state, offers, words)

    def offers(
        self,
        basis: information.Basis,
        levels: Mapping[str, float],
        seed: int,
        varying: Iterable[str] = (),
        work: Optional[Work] = None,
    ) -> List[Offer]:
        """What can be flown next; seed: of random inputs; varying: levels of what differs from flight
        to flight, which leave less information on forces that are always the same; work: gets how many
        flights were simulated."""
        found, work, all_pieces = [], work or Work(), pieces.pieces(basis.model, seed)
        with work.stage("simulating flights to choose from", len(all_pieces)):
            for piece in work.each(all_pieces):
                try:
                    motion = pieces.motion(piece, basis.model, self.room, NOISE)
                    found.append(self._offer(piece, motion, basis, levels, varying))
                except Diverged:
                    continue  # by this model its motion is not finite
        return found

    def _offer(
        self,
        piece: pieces.Piece,
        motion: pieces.Motion,
        basis: information.Basis,
        levels: Mapping[str, float],
        varying: Iterable[str] = (),
    ) -> Offer:
        """What a Piece tells by its expected motion."""
        run, seconds = motion
        likelihood = Likelihood([run], self.given, varying)
        return Offer(piece, information.of_runs(basis, likelihood, levels).matrix, seconds)

    def _hypotheses(
        self, found: diagnosis.StepwiseDiagnosis, conclusion: Conclusion
    ) -> Tuple[Dict[str, beliefs.Group], LikelihoodFit, _core.Model]:
        """The Groups of effects that were found and of a formula that is proposed; the fit and the model
        with all of them."""
        groups, formula = beliefs.found_by(found), conclusion.formula
        self._propose(found, conclusion)
        if formula is None:
            return groups, found.fit, found.model
        name, model = list(self.own)[-1], formula.fit.model.copy()
        model.remove_effect(str(formula.entry["name"]))
        groups[name] = beliefs.Group({name: 0.0}, formula.ratio)
        return groups, formula.fit, self._own(name).add(model)

    def _propose(self, found: diagnosis.StepwiseDiagnosis, conclusion: Conclusion) -> None:
        """Tries from now on what would explain what the library does not, in the place of earlier
        proposals that explain nothing."""
        self.depends = "depends on " + formula_words.in_words(list(conclusion.ceiling.arguments)[:2])
        formula = conclusion.formula
        if formula is None:
            return
        self.depends += " (%s)" % formula.means
        kept = {name for step in found.steps for name in step.group}
        self.own = {name: proposal for name, proposal in self.own.items() if name in kept}
        self.proposals += 1
        name = naming.NAME + ("_%d" % self.proposals if self.proposals > 1 else "")
        self.own[name] = Proposal(dict(formula.entry, name=name), formula.means, formula)


def sentences(found: FlightDiagnosis, formulas: Mapping[str, Mapping[str, str]]) -> List[str]:
    """What a diagnosis says, in a few sentences. formulas: of effects that the library does not have."""
    chosen = [c.name for c in found.diagnosis.chosen]
    said = []
    for name in found.words:
        parts = ["%s = %s" % part for part in sorted(formulas[name].items())]
        said.append("The library does not contain %s: %s." % (name, ", ".join(parts)))
    if found.conclusion.varies:
        names = [one.parameter for one in found.conclusion.varies]
        said.append("Differs from flight to flight: %s." % ", ".join(names))
    for label, text in prediction(found.conclusion.prediction, "refitted", "improved") if chosen else ():
        said.append("%s, without the effects and with them: %s." % (label, text))
    return said


def does(found: FlightDiagnosis) -> Dict[str, str]:
    """What the effects found do with their values, by name: effects of the library alone."""
    chosen = found.diagnosis.chosen
    said = {c.name: effect_words.of_fit(c.name, found.diagnosis.fit.parameters) for c in chosen}
    return {name: clause for name, clause in said.items() if clause}


def error(run: _core.RunData, model: _core.Model) -> Optional[float]:
    """Mean |e|/s of a model over the windows of a run; None where its motion is not finite."""
    try:
        found = float(window_error.channel_errors([run], windows.cut([run]), model).sum())
    except Diverged:
        return None
    return found if np.isfinite(found) else None


def off(run: _core.RunData, model: _core.Model, seconds: float) -> Optional[Off]:
    """How far the poses are off that a model predicts along a run; None where its motion is not finite."""
    chosen = horizon.starts([run], seconds, window_error.FEW_WINDOWS)
    try:
        error = PoseError.of(horizon.pose_errors([run], [model] * len(chosen), chosen, seconds))
    except Diverged:
        return None
    return error.position_mm, error.heading_deg


def expected_off(run: _core.RunData, model: _core.Model, seconds: float) -> Off:
    """How far the poses would be off if a model were true, because of their noise."""
    chosen = horizon.starts([run], seconds, window_error.FEW_WINDOWS)
    error = PoseError.of(horizon.artificial_errors([run], chosen, seconds, model, None))
    return error.position_mm, error.heading_deg


def expected_errors(run: _core.RunData, fit: LikelihoodFit, trimmed: bool = False) -> List[float]:
    """Errors that a fitted model is expected to have along a run that it was not fitted to: with the
    noise of poses and the random wrench, and a wrench that is constant in the run if `trimmed`."""
    cut, errors = windows.cut([run]), []
    for seed in range(SIMULATIONS):
        random = np.random.default_rng(seed)
        (wrench, room), thrust = window_error.pushes(run, fit.levels, random), 0.0
        if trimmed:
            wrench = wrench + [fit.levels["trim_" + c] * random.normal() for c in "XYN"]
            thrust = fit.levels["thrust"] * random.normal()
        artificial = window_error.recorded(run, fit.model, random, wrench, thrust, room)
        errors.append(float(window_error.channel_errors([artificial], cut, fit.model, [run]).sum()))
    return errors
