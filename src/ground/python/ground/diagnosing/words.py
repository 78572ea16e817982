"""The evidence of a diagnosis (contents of diagnosis.json) in sentences."""

import math
from typing import Dict, Iterator, List, Sequence

from ground.analysis.agreement import Common
from ground.analysis.formula_words import WORDS
from ground.analysis.residuals import UNITS
from ground.analysis.verdict import Varying
from ground.diagnosing.report import DiagnosisReport, Parameters, ReportedParameter
from ground.reading.recording import POSE
from ground.reports.words import capital, listed, number, off
from ground.support.quantities import quantity, with_interval

MIN_ROOM = 0.3  # part of the random wrench's force from which a force in the room is reported
MIN_ARGUMENT = 0.1  # least share of an argument that is named


def effect(report: DiagnosisReport, name: str) -> str:
    """An effect of a diagnosis in words with its name beside: "moving air (wind)". Names of a user's
    own effects, and of parameters, stay alone."""
    means = report.means.get(name)
    return "%s (%s)" % (means, name) if means else name


def effects(report: DiagnosisReport, names: Sequence[str]) -> str:
    """Some effects of a diagnosis in words."""
    return listed([effect(report, name) for name in names])


def varying(found: Varying) -> str:
    """A difference: "the yaw moment differs between runs (sd 9.1e-05 N m)"."""
    size = quantity(found.deviation, found.unit, 2)
    return "the %s differs between runs (sd %s)" % (found.parameter, size)


def parameter(name: str, p: ReportedParameter) -> str:
    """A parameter: "tau 50.02 ms (95%: 49.98 to 50.05 ms)", and of which values runs are that differ."""
    if not p.identified:
        return "%s cannot be identified from these data" % name
    return "%s %s" % (name, with_interval(p.value, *p.ci95, p.unit, p.runs))


def parameters(values: Parameters) -> List[str]:
    """A line for each parameter of an effect."""
    return [parameter(name, p) for name, p in values.items()]


def risen(report: DiagnosisReport) -> Iterator[str]:
    """What data that were held out say about effects that they do not confirm."""
    told = (
        "With %s, the log-likelihood of the runs %s changes by %+.1f (standard error %.1f), "
        "and the squared error of their predicted poses by %+.1f%% (%.1f%%)."
    )
    for step in report.steps:
        judged = step.judged
        for which, one in (
            ("that you held out", judged.holdout),
            ("fitted to, part by part", judged.fitted),
        ):
            if one and not one.is_better:
                rises = [one.rise, one.rise_error]
                whole = [math.nan if math.isnan(sum(rises)) else 100 * rise for rise in rises]
                yield told % (effect(report, step.added), which, one.gain, one.gain_error, *whole)


def apart(report: DiagnosisReport) -> Iterator[str]:
    """What these runs do not distinguish, and the experiment that would."""
    for c in report.candidates:
        if not c.seen:
            others = effects(report, c.group[1:])
            why = "a change of %s would look the same" % others if others else "it would not change them"
            yield "These runs cannot show %s: %s." % (effect(report, c.effect), why)
    for step in report.steps:
        others = effects(report, step.others)
        if others:
            yield "These runs cannot distinguish %s from %s." % (effect(report, step.added), others)
    proposed = report.next_experiment
    if proposed:
        yield "The next experiment: %s%s. One such run in %s separates %s by %.1f standard deviations." % (
            proposed.input,
            ", %d runs" % proposed.repeat if proposed.repeat > 1 else "",
            "the room %s" % proposed.room if proposed.room else "a room of 4 x 4 m",
            effects(report, proposed.separates),
            proposed.expected_disagreement,
        )


def arguments(report: DiagnosisReport) -> str:
    """What the learnable part depends on, in words."""
    shares = report.ceiling.arguments
    most = max(shares.values(), default=0.0)
    named = [WORDS[name] for name, share in shares.items() if share >= MIN_ARGUMENT * most]
    return listed(named) if named else "recorded quantities"


def _part(share: float, low: float, high: float) -> str:
    """A share with its 95% interval, if that is wider than the digits shown."""
    told = [_percent(value) for value in (share, low, high)]
    return "%s (%s to %s)" % tuple(told) if len(set(told)) > 1 else told[0]


def _percent(share: float) -> str:
    """A share in percent: what is not quite all or nothing is not shown as 100% or 0%."""
    if 0 < share < 0.005:
        return "<1%"
    return ">99%" if 0.995 < share < 1 else "%.0f%%" % (100 * max(0.0, min(1.0, share)))


def ceiling(report: DiagnosisReport) -> str:
    """How much of the error is named, how much could be learned, and how much is chance."""
    found, agrees = report.ceiling, report.agreement
    parts = [
        "further effects could explain " + _part(found.learnable.share, *found.learnable.ci95),
        _part(found.chance.share, *found.chance.ci95) + " is chance",
    ]
    if report.improved.effects:
        parts.insert(0, "the effects found explain " + _part(found.named.share, *found.named.ci95))
    text = "Of the squared error on the runs that the model was fitted to, %s." % listed(parts)
    text += " The further effects depend on %s." % arguments(report) if found.said else ""
    if not agrees.holds and number(report.noise_floor) != "-":
        errors = agrees.error.measured, agrees.error.expected
        why = "the error is %.3f, not %.3f" % errors
        if agrees.error.measured < agrees.error.expected:
            why = pattern(report)
        text += " These shares assume a steady random disturbance, but %s, so more may be missing." % why
    return text


def bands(report: DiagnosisReport) -> Iterator[str]:
    """Coverage of the prediction bands of the improved model."""
    shares: Dict[float, List[float]] = {}  # by horizon [s]
    for band in report.bands:
        if band.channel in POSE:
            shares.setdefault(band.horizon, []).append(band.coverage)
    if shares:
        yield "The model's 90%% prediction bands contain %s of the held-out poses." % ", ".join(
            "%.0f%% after %.1f s" % (100 * sum(found) / len(found), h) for h, found in shares.items()
        )


def left(report: DiagnosisReport) -> Iterator[str]:
    """What the grown model leaves: dropped effects, the disturbance."""
    for found in report.dropped:
        name, why = capital(effect(report, found.effect)), found.why
        if found.change:
            why += ": after %.2g s it moves the predicted pose by %s" % (
                found.change.seconds,
                off(found.change),
            )
        yield "%s was not added: %s." % (name, why)
    if not report.agreement.is_pushed:
        return
    levels = report.disturbance
    pushes = [
        "%s (correlation time %.2g s) in %s"
        % (quantity(levels["sigma_" + c], unit, 2), levels["time_" + c], where)
        for (c, unit), where in zip(UNITS.items(), ("surge", "sway", "yaw"))
    ]
    yield "A random disturbance also acts: %s (standard deviations)." % listed(pushes)
    if levels["sigma_room"] > MIN_ROOM * max(levels["sigma_X"], levels["sigma_Y"]):
        yield (
            "A random force of %s keeps its direction in the room while the craft turns, for about %.2g s, "
            "like a draught." % (quantity(levels["sigma_room"], "N", 2), levels["time_room"])
        )


def unexplained(report: DiagnosisReport) -> Iterator[str]:
    """An effect that would lower the remaining error."""
    proposal = report.unexplained.proposal
    if proposal:
        values = ["%s = %.4g %s" % (n, p.value, p.unit) for n, p in proposal.parameters.items()]
        terms = ["%s = %s" % item for item in proposal.expression.items()]
        means, error = capital(proposal.means), number(proposal.error.heldout)
        yield (
            "%s would lower the cross-validated error to %s (%s with %s). proposal.yaml contains it as an "
            "effect that can be added." % (means, error, "; ".join(terms), ", ".join(values))
        )


def extent(report: DiagnosisReport) -> Iterator[str]:
    """How much of the data was used, if not all."""
    seconds, windows = report.seconds, report.windows
    if seconds and seconds.used < seconds.available:
        yield "Effects were searched in the %.0f of %.0f s in which the craft moves most." % (
            seconds.used,
            seconds.available,
        )
    if windows.used < windows.available:
        yield "Errors cover %d of %d windows, spread evenly over the runs." % (
            windows.used,
            windows.available,
        )


def common(found: Common) -> str:
    """The part of the missing force that runs with the same commands share."""
    part = _part(found.share, found.low, found.high)
    return "runs with the same commands share %s of the missing force" % part


def pattern(report: DiagnosisReport) -> str:
    """How the remaining error differs from a steady random disturbance."""
    found = report.agreement
    if found.frequency:
        return (
            "the remaining error peaks at %.2g Hz: something seems to swing or turn at this rate, such as a "
            "fan or an unbalanced motor" % found.frequency
        )
    if found.common and found.common.stands_out:
        return common(found.common) + ", which no effect of the library and no recorded quantity describes"
    return "the rest acts only at some times or places, as gusts, cables, a bad floor or late commands would"


def evidence(report: DiagnosisReport) -> Iterator[str]:
    """The lines of --details."""
    if report.is_misread:
        return
    yield ceiling(report)
    sensed = report.runs.inertial
    if sensed:
        which = "" if len(sensed) == len(report.runs.fit) else " of " + listed(sensed)
        yield "The likelihood also uses the craft's gyro and accelerometer%s." % which
    yield from bands(report)
    yield ""
    form = "%4s %9s %11s %9s %9s  %s"
    yield form % ("rank", "p", "p_corrected", "dBIC", "crossed", "effect: parameters [95%]")
    alone = number(report.nominal.cross_validated)
    yield form % ("-", "-", "-", "-", alone, "none, refitted by likelihood, as are all below")
    for c in report.candidates[:8]:
        name = "* " * c.selected + effect(report, c.effect)
        values = "; ".join(parameters(c.parameters))
        p = "-" if math.isnan(c.p) else "%.1g" % c.p  # older reports have none
        numbers = p, "%.1g" % c.p_corrected, "%.0f" % c.delta_bic, number(c.error.heldout)
        yield form % (c.rank, *numbers, "%s: %s" % (name, values))
    held = report.runs.is_held_out
    name = "error on held-out runs:" if held else "cross-validated error:"
    yield "%-23s %s refitted" % (name, number(report.nominal.error.heldout))
    for step in report.steps:
        yield "%23s %s + %s" % ("", number(step.error.heldout), effect(report, step.added))
    yield "%29s noise floor" % number(report.noise_floor)
    if held:
        yield (
            "The cross-validated error of the fitted runs, each by a fit to the others, is %s without "
            "further effects and %s with those found."
            % (number(report.nominal.cross_validated), number(report.improved.cross_validated))
        )
    for lines in (risen, extent, left, apart, unexplained):
        yield from lines(report)
