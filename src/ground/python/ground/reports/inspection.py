"""Inspection of one model on one run: its numbers, and what stands out in sentences."""

from typing import Dict, List, Mapping, Optional

from ground import _core
from ground.analysis import comparison, missing_wrench, residuals
from ground.reports import appearance
from ground.support.annotations import Document
from ground.support.errors import GroundError

PLACES = {"ahead": "ahead", "starboard": "to starboard", "heading": "in heading"}


def inspect(run: _core.RunData, model: _core.Model, label: str, role: str = "fit") -> Document:
    """Errors of a model on a _core.RunData, correlations of the residuals and the missing wrench, as a
    dictionary.

    role: the run's role for the model, "fit" or "held_out". Raises GroundError when the model cannot be
    simulated along the run.
    """
    try:
        evaluation = comparison.evaluate(run, model)
        calm = missing_wrench.undisturbed(model, run)
        correlation = residuals.analyse(calm.run, model, calm.box, calm.white)
        missing = missing_wrench.of_wrench(calm, model)
    except (ValueError, RuntimeError) as error:
        raise GroundError("%s with %s: %s" % (run.name, label, error))
    numbers = comparison.numbers([evaluation])
    said = [
        _left_out(missing.numbers["disturbances"]),
        _largest_missing(missing.numbers["channels"]),
        _followed_input(correlation["channels"], residuals.commands(model)),
        _worst(numbers["error_by_channel"]),
    ]
    return {
        "label": label,
        "run": run,
        "model": model,
        "role": role,
        "evaluation": evaluation,
        "numbers": numbers,
        "residuals": correlation,
        "missing": missing,
        "summary": [sentence for sentence in said if sentence],
    }


def _left_out(events: List[Document]) -> str:
    spans = ", ".join("%.1f to %.1f" % (e["start"], e["end"]) for e in events)
    why = "left out of what follows, because no input explains the motion (contact, hand, wrong poses): %s s"
    return why % spans if spans else ""


def _largest_missing(channels: Document) -> str:
    """The channel with the largest missing wrench, relative to full thrust."""
    name = max(channels, key=lambda c: float(channels[c]["rms"] / channels[c]["full_scale"]))
    channel = channels[name]
    if missing_wrench.is_negligible(channel):
        return "the missing force and moment are smaller than their uncertainty"
    ratio = channel["rms"] / channel["full_scale"]
    return "the largest missing part is %s: %.3g %s rms (%s full thrust), mean %.3g %s" % (
        missing_wrench.CHANNEL_NAMES[name],
        channel["rms"],
        channel["unit"],
        "%.0f%% of" % (100 * ratio) if ratio < 10 else "far above",
        channel["mean"],
        channel["unit"],
    )


def _followed_input(channels: Document, commands: Mapping[str, str]) -> Optional[str]:
    """The command that the residuals follow most, and with which delay; None without one."""
    strongest, text = 0.0, None
    for channel, entry in channels.items():
        for kind, name in commands.items():
            found = entry[kind]
            if found is None or found["accepted"]:
                continue
            after = [i for i, lag in enumerate(found["lag_seconds"]) if lag > -1e-9]
            at = max(after, key=lambda i: float(abs(found["value"][i])))
            value, late = found["value"][at], 1e3 * found["lag_seconds"][at]
            if abs(value) > max(strongest, found["band99"][at]):
                strongest = abs(value)
                text = "residuals %s still follow %s, most %.0f ms after it (correlation %.2f)" % (
                    PLACES[channel], name, late, value,
                )  # fmt: skip
    return text


def _worst(by_channel: Dict[str, float]) -> str:
    """The channel with the largest part of the error."""
    name = max(by_channel, key=by_channel.__getitem__)
    share = by_channel[name] / max(1e-300, sum(by_channel.values()))
    return "%.0f%% of the error is in the %s" % (100 * share, appearance.CHANNEL_NAMES[name])
