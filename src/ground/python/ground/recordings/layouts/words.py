"""Hypotheses and verdicts in words, and the options that mend what a hypothesis supposes."""

import math
from typing import Iterator, List, Sequence, Tuple

from ground.recordings import settings, units
from ground.recordings.layouts.hypotheses import Hypothesis
from ground.recordings.layouts.verdicts import Verdict

AS_RECORDED = "channels and heading are as recorded"
MAX_OPEN = 3  # hypotheses that are not refuted that are named
HARDLY = 0.3  # share of all hypotheses; where more are open, none is named
TURNS = ((math.pi, "half a turn"), (math.pi / 2, "a quarter turn"), (-math.pi / 2, "a quarter turn"))
CHANNELS = "under commands.channels in a mapping"
POSES = "under poses in a mapping"
MIRRORED = "a minus before one of position's fields " + POSES
OTHER_SIGN = "heading: {sign: -1} " + POSES


def kind(hypothesis: Hypothesis, names: Sequence[str]) -> str:
    """The first mistake that a hypothesis supposes, in a word."""
    if list(hypothesis.channels) != list(names):
        return "swap"
    if hypothesis.upside_down:
        return "upside_down"
    if hypothesis.twisted:
        return "mirror" if hypothesis.mirrored else "yaw"
    if -1 in hypothesis.signs:
        return "invert"
    if 0 in hypothesis.signs:
        return "dead"
    return "offset" if hypothesis.heading_offset else ""


def suppositions(hypothesis: Hypothesis, names: Sequence[str], seem: bool = False) -> str:
    """What a hypothesis supposes, in words; seem: as a suspicion."""
    is_, are = ("seems to be", "seem to be") if seem else ("is", "are")
    found = ["%s and %s %s swapped" % (*pair, are) for pair in _swapped(hypothesis, names)]
    found += ["%s %s driven by %s" % (a, is_, b) for a, b in _moved(hypothesis, names)]
    dead = [c for c, sign in zip(hypothesis.channels, hypothesis.signs) if sign == 0]
    found += ["%s %s" % (c, "seems to do nothing" if seem else "does nothing") for c in dead]
    inverted = _inverted(hypothesis)
    if inverted:
        found.append("%s %s inverted" % (inverted, is_ if hypothesis.signs.count(-1) == 1 else are))
    if hypothesis.upside_down:
        found.append("the mocap's vertical axis %s upside down" % is_)
    elif hypothesis.mirrored:
        found.append("the positions %s mirrored" % are)
    elif hypothesis.heading_sign < 0:
        found.append("the heading %s of the wrong sign" % is_)
    if hypothesis.heading_offset:
        found.append("the heading %s off by %s" % (is_, _angle(hypothesis.heading_offset)))
    return _listed(found) or AS_RECORDED


def alternatives(some: Sequence[Hypothesis], names: Sequence[str]) -> str:
    """What hypotheses suppose that are the same to any motion."""
    found = [suppositions(some[0], names, True)]
    return ", or equally ".join(found + [suppositions(other, names) for other in some[1:]])


def remedies(
    hypothesis: Hypothesis, names: Sequence[str], measured: settings.Settings
) -> List[str]:
    """The options and keys of a mapping that mend what a hypothesis supposes; measured: the settings of
    the poses."""
    pairs = ", and of ".join("%s and %s" % pair for pair in _swapped(hypothesis, names))
    found = ["exchange the fields of %s %s" % (pairs, CHANNELS)] if pairs else []
    found += ["give %s the field of %s %s" % (*pair, CHANNELS) for pair in _moved(hypothesis, names)]
    inverted = _inverted(hypothesis)
    if inverted:
        found.append("exchange the values off and full of %s %s" % (inverted, CHANNELS))
    found += [
        "look whether the motor of %s turns, and whether %s has the right field %s"
        % (thruster, channel, CHANNELS)
        for thruster, channel, sign in zip(names, hypothesis.channels, hypothesis.signs)
        if sign == 0
    ]
    before = measured.changes[0]
    quaternions = "axes" in measured.taken
    if hypothesis.upside_down and quaternions:
        found.append('--axes "%s"' % units.upside_down(before.axes))
    elif hypothesis.upside_down:
        found.append("%s and %s" % (OTHER_SIGN, MIRRORED))
    elif hypothesis.twisted:
        found.append(MIRRORED if hypothesis.mirrored else OTHER_SIGN)
    if hypothesis.heading_offset:
        offset = hypothesis.heading_sign * before.heading_offset + hypothesis.heading_offset
        found.append("--heading-offset %.2f" % math.remainder(offset, 2 * math.pi))
    return found


def evidence(verdict: Verdict) -> str:
    """What speaks for a verdict's best hypothesis."""
    text = "the commands explain %.0f%% of the forces and %.0f%% of the turns" % (
        100 * verdict.best.force,
        100 * verdict.best.turn,
    )
    if verdict.is_as_recorded:
        return text
    low, high = verdict.recorded.ratio95
    return (
        text
        + " then, %.0f%% and %.0f%% as they are, which leaves %.2f times the accelerations unexplained "
        "(95%%: %.2f to %.2f)"
        % (100 * verdict.recorded.force, 100 * verdict.recorded.turn, verdict.recorded.ratio, low, high)
    )


def sentence(verdict: Verdict) -> str:
    """A verdict with its evidence, what is the same to any motion, and what cannot be decided."""
    names = verdict.recorded.hypothesis.channels
    parts = ["%s: %s" % (suppositions(verdict.best.hypothesis, names, True), evidence(verdict))]
    if verdict.same and not verdict.is_as_recorded:
        parts.append("the same to any motion: " + "; or ".join(_each(verdict.same, names)))
    open_still = [found.hypothesis for found in verdict.undecided]
    if open_still and verdict.open_share > HARDLY:
        parts.append("the recordings do not decide which channel drives which thruster: %s" % verdict.why)
    elif open_still:
        named = "; or ".join(_each(open_still[:MAX_OPEN], names))
        more = len(open_still) - MAX_OPEN
        others = "; or another" if more > 0 else ""
        parts.append("it cannot be decided whether %s%s, because %s" % (named, others, verdict.why))
    return "; ".join(parts)


def _each(some: Sequence[Hypothesis], names: Sequence[str]) -> Iterator[str]:
    return (suppositions(hypothesis, names) for hypothesis in some)


def _swapped(hypothesis: Hypothesis, names: Sequence[str]) -> Iterator[Tuple[str, str]]:
    """Pairs of thrusters that have each other's channel."""
    driven = dict(zip(names, hypothesis.channels))
    for thruster, channel in driven.items():
        if driven[channel] == thruster and names.index(thruster) < names.index(channel):
            yield thruster, channel


def _moved(hypothesis: Hypothesis, names: Sequence[str]) -> Iterator[Tuple[str, str]]:
    """Thrusters and their channels where these are of another one in a longer cycle."""
    driven = dict(zip(names, hypothesis.channels))
    for thruster, channel in driven.items():
        if channel != thruster and driven[channel] != thruster:
            yield thruster, channel


def _inverted(hypothesis: Hypothesis) -> str:
    """Names of the inverted channels."""
    inverted = [c for c, sign in zip(hypothesis.channels, hypothesis.signs) if sign < 0]
    if len(inverted) < max(2, len(hypothesis.signs)):
        return _listed(inverted)
    return "both thrusters" if len(inverted) == 2 else "all thrusters"


def _angle(offset: float) -> str:
    for turn, words in TURNS:
        if abs(math.remainder(offset - turn, 2 * math.pi)) < 1e-6:
            return words
    return "%.0f degrees" % math.degrees(offset)


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + list(names[-1:]))
