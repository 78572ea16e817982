"""What the flights so far have shown: a diagnosis of all of them, and what it leaves open."""

from dataclasses import dataclass
from typing import Dict, Iterable, List, Mapping, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import candidates, diagnosis, memory, naming, pushes, study
from ground.analysis.conclusion import EXPLAINED, Conclusion, conclude
from ground.analysis.likelihood import Fit, Likelihood
from ground.annotations import Document
from ground.discovery import beliefs, information, pieces
from ground.discovery.beliefs import State
from ground.discovery.information import Offer, Question
from ground.errors import GroundError
from ground.recordings import suspicions, windows
from ground.recordings.recording import Recording

# Expected before the first flight: noise of the poses and random wrench
NOISE = np.array([3e-4, 3e-4, 5e-3])  # [m], [m], [rad]
DISTURBANCE = 0.05  # relative to the level that fits start from
UNDECIDED = "undecided"  # the verdict on flights that cannot decide whether something is missing
SIMULATIONS = 20  # artificial flights that give the distribution of an error


@dataclass(frozen=True)
class Found:
    """A diagnosis of all flights so far."""

    diagnosis: diagnosis.Diagnosis
    conclusion: Conclusion
    state: State
    offers: List[Offer]  # what can be flown next

    @property
    def model(self) -> _core.Model:
        """The improved model."""
        return self.conclusion.improved

    @property
    def verdict(self) -> str:
        """That of the conclusion."""
        return self.conclusion.verdict

    @property
    def asked(self) -> List[Question]:
        """Open questions about effects."""
        tested = self.state.questions.basis.columns
        return [q for q in self.state.open if q.rival or q.about in tested]

    @property
    def is_left_open(self) -> bool:
        """Whether something may be left that the random wrench only stands in for: the noise of poses
        does not explain the error, and what is left is not shown to be chance."""
        if self.verdict == UNDECIDED:
            return True
        explained = self.diagnosis.best.error.sum() < EXPLAINED * self.conclusion.noise_floor
        left = self.conclusion.ceiling.is_open or not self.conclusion.agreement.holds
        return self.verdict in ("complete", "missing", "varies") and not explained and left


class Analyst:
    """Diagnoses flights of a craft, given its model before the first one. threads: 0 for all cores."""

    def __init__(self, given: _core.Model, room: _core.RoomPlan, threads: int = 0) -> None:
        self.given, self.room, self.threads = given, room, threads
        self.own: List[candidates.Candidate] = []  # effects that were proposed on the way
        self.depends = "depends on what is not measured"  # what the last diagnosis left unexplained
        self.formulas: Dict[str, Dict[str, str]] = {}  # theirs, by channel of the wrench or thruster
        self.sizes: Dict[str, float] = {}  # those that matter, by parameter of an effect
        self._prepare()

    def _prepare(self) -> None:
        """Computes what is known before the first flight."""
        first = [
            (piece, pieces.motion(piece, self.given, self.room, 0.0, NOISE))
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
        """Effects of the library, proposed effects and kinds of memory that a model does not have."""
        library = candidates.library(model)
        past = [
            kind.at(kind.tried[-1], model)
            for kind in memory.kinds_of(model)
            if kind.name not in model.effects
        ]
        own = [c for c in self.own if c.name not in model.effects]
        return library + own + past

    def basis(self, model: _core.Model) -> information.Basis:
        """The Basis of a model and all effects that may be missing in it."""
        return information.Basis.of(model, self.missing(model))

    def measure(self, basis: information.Basis, known: information.Information) -> None:
        """Finds the sizes that matter of effects whose size is not known yet."""
        if not all(name in self.sizes for name in basis.names[len(basis.free) :]):
            missing = self.missing(basis.model)
            found = information.sizes_that_matter(basis, missing, self.overview, known)
            self.sizes = {**found, **self.sizes}

    def misread(self, recordings: Sequence[Recording]) -> List[str]:
        """Why recordings look misread, so that an effect found in them would not be physics; empty if
        they do not."""
        doubts = suspicions.of_runs(recordings) + suspicions.of_thrusters(recordings, self.given)
        return [doubt.sentence for doubt in doubts if doubt.misread]

    def diagnose(self, recordings: Sequence[Recording], reachable: float, seed: int) -> Found:
        """Diagnoses recordings. reachable: time that is left for flights [s]; seed: of what is offered
        for the next one. GroundError when they are too short."""
        runs = [recording.repaired.data(self.given) for recording in recordings]
        library = candidates.library(self.given)
        found = diagnosis.Diagnosis(runs, self.given, library + self.own, threads=self.threads)
        found.grow()
        conclusion = conclude(found)
        basis = self.basis(found.model)
        known = information.of_runs(basis, found.likelihood, found.fit.levels, found.fit.loudness)
        self.measure(basis, known)
        offers = self.offers(basis, found.fit.levels, seed, found.likelihood.varying)
        later = information.mean_rate(offers) * reachable
        noise = conclusion.noise_floor / conclusion.heldout[0]
        state = beliefs.after(found, basis, known, self.sizes, later, noise)
        return Found(found, conclusion, state, offers)

    def offers(
        self,
        basis: information.Basis,
        levels: Mapping[str, float],
        seed: int,
        varying: Iterable[str] = (),
    ) -> List[Offer]:
        """What can be flown next; seed: of random inputs; varying: levels of what differs from flight
        to flight, which leave less information on forces that are always the same."""
        found = []
        for piece in pieces.pieces(basis.model, seed):
            try:
                motion = pieces.motion(piece, basis.model, self.room, 0.0, NOISE)
                found.append(self._offer(piece, motion, basis, levels, varying))
            except GroundError:
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

    def _add(self, entry: Document, name: str) -> None:
        """Tries an effect from now on."""
        self.formulas[name] = dict(entry["expression"])
        self.own.append(candidates.from_entry(dict(entry, name=name), name, self.given))

    def propose(self, found: Found) -> None:
        """Adds an effect that would explain what the library does not to those that are tried from
        now on, if there is one."""
        remembered = found.conclusion.memory
        if remembered is not None:
            entry: Optional[Document] = remembered.entry
            self.depends = "depends on the past (%s)" % remembered.means
        else:
            formula, shares = found.conclusion.formula, found.conclusion.ceiling.arguments
            is_formula = formula is not None and "expression" in formula.entry
            entry = formula.entry if formula is not None and is_formula else None
            self.depends = "depends on " + naming.in_words(list(shares)[:2] or [])
        if entry is None:
            return
        name = str(entry["name"])
        if name in self.formulas and remembered is None and name in found.model.effects:
            name = "%s_%d" % (name, len(self.formulas) + 1)
        if name not in self.formulas:
            self._add(entry, name)


def error(run: _core.RunData, model: _core.Model) -> Optional[float]:
    """Mean |e|/s of a model over the windows of a run; None where its motion is not finite."""
    try:
        found = float(study.channel_errors([run], windows.cut([run]), model).sum())
    except GroundError:
        return None
    return found if np.isfinite(found) else None


def expected_errors(
    run: _core.RunData, fit: Fit, count: int = SIMULATIONS, trimmed: bool = False
) -> List[float]:
    """Errors that a fitted model is expected to have along a run that it was not fitted to: with the
    noise of poses and the random wrench, and a wrench that is constant in the run if `trimmed`."""
    cut, errors = windows.cut([run]), []
    for seed in range(count):
        random = np.random.default_rng(seed)
        drawn = pushes.of_levels(run, fit.levels, random)
        wrench, thrust = drawn.wrench, 0.0
        if trimmed:
            wrench = wrench + [fit.levels["trim_" + c] * random.normal() for c in "XYN"]
            thrust = fit.levels["thrust"] * random.normal()
        artificial = study.recorded(run, fit.model, random, wrench, thrust, drawn.room)
        errors.append(float(study.channel_errors([artificial], cut, fit.model, [run]).sum()))
    return errors
