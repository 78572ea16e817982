"""Which flight comes next."""

from dataclasses import dataclass, replace
from typing import Callable, List, Sequence, Tuple

from ground import _core
from ground.discovery import information
from ground.discovery.beliefs import State
from ground.discovery.information import DECIDED, Offer
from ground.discovery.pieces import Piece, pieces
from ground.support.annotations import Array

MAX_FLIGHT = 16.0  # longest flight of an excitation [s]
NAMED = 4  # open questions that a reason names
REST = (
    "Something may be left that neither an effect nor chance explains; random inputs show what it depends on."
)
CONFIRMING = (
    "PRBS of 10 Hz between 0 and 1 of full thrust",
    "random levels, 0.25 s each",
    "random levels, 0.25 s each, lift at 0.6",
)


@dataclass(frozen=True)
class Chosen:
    """Pieces of the next flight, and why."""

    pieces: List[Piece]
    why: str


# Chooses the pieces of the next excitation, by what is known, what can be flown, the time that is left
# [s] and the seed of the flight.
Chooser = Callable[[State, Sequence[Offer], float, int], Chosen]


def informed(state: State, offers: Sequence[Offer], longest: float, seed: int) -> Chosen:
    """Chooses the pieces that remove most doubt per second. See Chooser."""
    asked = replace(state.questions, asked=state.open)
    known = state.information.matrix
    chosen = information.greedy(asked, known, offers, min(MAX_FLIGHT, longest)) or [offers[0]]
    after = known + sum(offer.gain for offer in chosen)
    return Chosen([offer.piece for offer in chosen], _reason(asked, known, after))


def rest(model: _core.Model, seed: int) -> Chosen:
    """A flight that shows what effects leave, whatever it depends on: random sequences."""
    return Chosen(confirming(model, seed), REST)


def confirming(model: _core.Model, seed: int) -> List[Piece]:
    """Pieces of a flight that no choice has made: random sequences."""
    return [piece for piece in pieces(model, seed) if piece.words in CONFIRMING]


def _reason(asked: information.Questions, known: Array, after: Array) -> str:
    """What a flight is expected to decide, in a sentence."""
    pairs: List[Tuple[information.Question, float, float]] = list(
        zip(asked.asked, asked.visibility(known), asked.visibility(after))
    )
    effects = [(q, a, b) for q, a, b in pairs if q.rival or q.about in asked.basis.columns]
    decided = [q.words for q, a, b in effects if b >= DECIDED]
    rivals = [q.words for q, _, _ in effects if q.rival]
    if not effects:
        return "It makes the parameters more precise."
    if rivals:
        return "It is expected to distinguish %s." % " and ".join(rivals)
    named = ", ".join(decided[:NAMED]) + (", ..." if len(decided) > NAMED else "")
    if not decided:
        return "It makes %d of the open effects more visible." % len(effects)
    return "It is expected to decide %d of %d open effects (%s)." % (
        len(decided), len(effects), named,
    )  # fmt: skip
