"""Inspection of one model on one run: its numbers, and what stands out in sentences."""

from dataclasses import dataclass
from typing import Dict, List, Mapping, NamedTuple, Optional, Sequence

from ground import _core
from ground.analysis import comparison, missing_wrench, residuals
from ground.analysis.residuals import ChannelCorrelations, Correlation, ResidualTests
from ground.reports import appearance
from ground.support.annotations import Array, Document
from ground.support.errors import core_error
from ground.support.quantities import quantity

PLACES = {"ahead": "ahead", "starboard": "to starboard", "heading": "in heading"}
CHANNELS = {"ahead": "X", "starboard": "Y", "heading": "N"}  # of the wrench, by channel of the residuals
Channels = Mapping[str, missing_wrench.WrenchChannel]
FORCES = {"X": "surge force", "Y": "side force", "N": "yaw moment"}


@dataclass(frozen=True)
class PredictionBand:
    """Ends of a band about each piece of a predicted motion: x, y, psi, u, v, r (k, 6)."""

    level: float  # probability that it holds the measurement
    low: List[Array]
    high: List[Array]


@dataclass(frozen=True)
class SimulatedMotion:
    """A run, and what a model makes of it."""

    label: str  # the model's
    run: _core.RunData
    model: _core.Model
    pieces: Sequence[Mapping[str, Array]]  # times (k,), eta and nu (k, 3) of each
    errors: Mapping[str, float]  # mean error of u, v, r [standard deviations]
    band: Optional[PredictionBand]


@dataclass(frozen=True)
class Inspection(SimulatedMotion):
    """A model on one run: its errors, correlations of the residuals, and the missing wrench."""

    role: str  # the run's role for the model: fit or held_out
    evaluation: comparison.Evaluation
    numbers: Document  # comparison.numbers
    residuals: ResidualTests
    missing: missing_wrench.MissingWrench
    left_out: str  # spans that are left out of residuals and wrench, in words; may be empty
    summary: List[str]  # what stands out, in sentences


def inspect(run: _core.RunData, model: _core.Model, label: str, role: str = "fit") -> Inspection:
    """The Inspection of a model on a run. GroundError when the model cannot be simulated along it."""
    try:
        evaluation = comparison.evaluate(run, model)
        calm = missing_wrench.undisturbed(model, run)
        correlation = residuals.analyse(calm.run, model, calm.box, calm.white)
        missing = missing_wrench.of_wrench(calm, model)
    except (ValueError, RuntimeError) as error:
        raise core_error(error, "%s with %s" % (run.name, label))
    numbers = comparison.numbers([evaluation])
    left_out = _left_out(missing.numbers.disturbances)
    said = [
        left_out,
        _largest_missing(missing.numbers.channels),
        _followed_input(correlation.channels, residuals.commands(model)),
        _worst(numbers["error_by_channel"]),
    ]
    return Inspection(
        label,
        run,
        model,
        evaluation.pieces,
        numbers["error_by_channel"],
        None,
        role,
        evaluation,
        numbers,
        correlation,
        missing,
        left_out,
        [sentence for sentence in said if sentence],
    )


def missing_in(study: Inspection) -> str:
    """What is missing in the model of a study: "missing in refitted: a yaw moment of 0.7 mN m rms (18% of
    full thrust), which follows the command u_L-u_R"."""
    channels = study.missing.numbers.channels
    name = _largest(channels)
    if channels[name].is_negligible:
        return "no force is missing in %s beyond the uncertainty" % study.label
    told = "missing in %s: a %s of %s" % (study.label, FORCES[name], _size(channels[name]))
    followed = _followed(study.residuals.channels, residuals.commands(study.model))
    if followed and CHANNELS[followed.channel] == name:
        told += ", which follows the command %s%s" % (followed.command, followed.later)
    return told


def _left_out(events: Sequence[missing_wrench.Disturbed]) -> str:
    spans = ", ".join("%.1f to %.1f" % (e.start, e.end) for e in events)
    why = "left out below, because no input explains the motion (contact, hand, wrong poses): %s s"
    return why % spans if spans else ""


def _largest(channels: Channels) -> str:
    """The channel with the largest missing wrench, relative to full thrust."""
    return max(channels, key=lambda c: channels[c].rms / channels[c].full_scale)


def _size(channel: missing_wrench.WrenchChannel) -> str:
    ratio = channel.rms / channel.full_scale
    part = "%.0f%% of" % (100 * ratio) if ratio < 10 else "far above"
    return "%s rms (%s full thrust)" % (quantity(channel.rms, channel.unit, 2), part)


def _largest_missing(channels: Channels) -> str:
    """The largest missing part of the wrench, in a sentence."""
    name = _largest(channels)
    if channels[name].is_negligible:
        return "the missing force and moment are smaller than their uncertainty"
    mean = quantity(channels[name].mean, channels[name].unit, 2)
    return "the largest missing part is the %s: %s, mean %s" % (FORCES[name], _size(channels[name]), mean)


class _Followed(NamedTuple):
    """The command that residuals follow most."""

    channel: str  # of the residuals
    command: str
    late: float  # [ms]
    correlation: float

    @property
    def later(self) -> str:
        return ", most closely after %.0f ms" % self.late if self.late >= 1 else ""


def _followed(
    channels: Mapping[str, ChannelCorrelations], commands: Mapping[str, str]
) -> Optional[_Followed]:
    """The command that the residuals follow most; None without one."""
    strongest, found = 0.0, None
    for channel, entry in channels.items():
        for kind, name in commands.items():
            of: Optional[Correlation] = getattr(entry, kind)
            if of is None or of.accepted:
                continue
            values = of.value
            after = [i for i, lag in enumerate(of.lag_seconds) if lag > -1e-9]
            at = max(after, key=lambda i: abs(values[i]))
            value, late = values[at], 1e3 * of.lag_seconds[at]
            if abs(value) > max(strongest, of.band99[at]):
                strongest, found = abs(value), _Followed(channel, name, late, value)
    return found


def _followed_input(
    channels: Mapping[str, ChannelCorrelations], commands: Mapping[str, str]
) -> Optional[str]:
    """The same in a sentence."""
    found = _followed(channels, commands)
    if found is None:
        return None
    return "the motion %s follows the command %s%s in a way that the model lacks (correlation %.2f)" % (
        PLACES[found.channel],
        found.command,
        found.later,
        found.correlation,
    )


def _worst(by_channel: Dict[str, float]) -> str:
    """The channel with the largest part of the error."""
    name = max(by_channel, key=by_channel.__getitem__)
    share = by_channel[name] / max(1e-300, sum(by_channel.values()))
    return "%.0f%% of the error is in the %s" % (100 * share, appearance.CHANNEL_NAMES[name])
