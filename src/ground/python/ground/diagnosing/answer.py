"""The first lines of a diagnosis (contents of diagnosis.json): what is missing, how much it matters, where
the model with it is, and what to do next."""

import math
import os
import shlex
from typing import Iterator, List, Mapping, Union

from ground.analysis.diagnosis import EXPLAINED
from ground.analysis.distributions import LEVEL
from ground.diagnosing import words
from ground.diagnosing.report import AddedEffect, DiagnosisReport, ScreenedEffect, TriedEffect
from ground.effect_library import candidates
from ground.reports import effect_words
from ground.reports.words import capital, is_pushed, listed, number, off, prediction, ratio, unit_of_length
from ground.support import records
from ground.support.annotations import Document
from ground.support.headline import Line

LIKELIER = "likelier, but predicts worse than the model without it"
NOT_SIGNIFICANT = "not significant among the %d effects tried"
NOT_JUDGED = "likelier; its predictions were not tested"
MAX_SIZES = 3  # parameters of an effect that a row of its search has
FEW = 3  # effects that need no sentence on all of them
DENIED = 0.0499  # at an end of an interval of 95% the probability is 0.05, but for rounding
# Words by the largest probability of as much evidence without the effect
CERTAINTY = ((1e-6, "Very certain"), (1e-3, "Certain"), (math.inf, "Likely"))


def tried(
    row: Union[ScreenedEffect, TriedEffect], count: int, means: Mapping[str, str], without: float = math.inf
) -> Document:
    """What is known of a single effect as plain values, with its meaning, size and certainty in words; count:
    of the effects that were tried; means: meanings of effects that are not of the library; without: the
    cross-validated error of the refitted model."""
    sure = NOT_SIGNIFICANT % count
    if row.p_corrected < LEVEL:
        sure = _judged(row, without) or _sure(row.p_corrected)
    sizes = [words.parameter(name, one) for name, one in row.parameters.items() if one.identified]
    return {
        **records.plain(row),
        "meaning": candidates.summaries().get(row.effect) or means.get(row.effect, ""),
        "size": ", ".join(sizes[:MAX_SIZES]) or "not identifiable from these runs",
        "certain": sure,
    }


def _judged(row: Union[ScreenedEffect, TriedEffect], without: float) -> str:
    """What predictions say against an effect; empty if nothing."""
    if isinstance(row, ScreenedEffect):
        worse = row.prediction and row.given and ratio(row.prediction, row.given) > 1
        return LIKELIER if worse else ""
    if row.error.heldout is None:
        return NOT_JUDGED
    return LIKELIER if row.error.heldout > without else ""


def _sure(chance: float) -> str:
    """The word for a probability of as much evidence without the effect."""
    return next(word for most, word in CERTAINTY if chance < most)


def lines(report: DiagnosisReport, folder: str = "") -> List[Line]:
    """All first lines; folder: of the results; empty: they are not written, and commands are for
    Python."""
    return [*known_first(report), *known_last(report, folder)]


def known_first(report: DiagnosisReport) -> List[Line]:
    """The lines that need the verdict only."""
    head = [("" if i else "Missing", text) for i, text in enumerate(_answers(report))]
    if report.is_misread:
        return head
    count, beside = len(report.improved.effects), {}
    if count:
        beside["refitted"] = "refitted without the effect%s" % ("s" * (count > 1))
    if report.ceiling.named_as:
        beside["formula"] = "with the proposed formula"
    if report.varies:
        own = listed([found.parameter for found in report.varies])
        beside["written"] = "with the same %s in all runs" % own
    return head + prediction(report.prediction, "given", "improved" if count else "refitted", **beside)


def known_last(report: DiagnosisReport, folder: str) -> Iterator[Line]:
    """The other lines: files, and what to do next."""
    found = report.improved.effects
    if report.verdict != "misread":
        saved = _in(folder, "improved.yaml") if folder else "not saved yet"
        yield "Model with %s" % ("it" if len(found) == 1 else "them") if found else "Model, refitted", saved
    yield "Next", _next(report, folder)
    if folder:
        yield "Details", _in(folder, "report.html")


def _in(folder: str, name: str) -> str:
    """A file of a folder."""
    return os.path.normpath(os.path.join(folder, name))


def title(report: DiagnosisReport) -> str:
    """The answer in a sentence."""
    return "Missing: " + " ".join(_answers(report))


def _answers(report: DiagnosisReport) -> Iterator[str]:
    if report.is_misread:
        yield (
            "not searched - these recordings seem to have wrong units, axes, channels or clocks, "
            "and effects found in them would be wrong."
        )
        for found in report.findings:
            yield found.sentence
        return
    if len(report.steps) > FEW:
        yield _all_together(report)
    for step in report.steps:
        yield _effect(report, step)
    if report.varies and report.verdict != "varies":
        differ = capital(listed([words.varying(found) for found in report.varies]))
        yield "%s; each prediction estimates it from the preceding poses." % differ
    yield from (capital(one.evidence) + "." for one in report.changes)
    rest = _rest(report)
    if rest:
        yield rest
    if report.improved.by == "simulation":
        yield "The model is fitted by simulation error, which predicts better than the likelihood fit."
    if report.steps and not rest and _rest_matters(report):
        yield capital(_left(report))


def _all_together(report: DiagnosisReport) -> str:
    """What many effects do together, before each of them."""
    told = "%d effects, the most needed first" % len(report.steps)
    if report.prediction:
        left = 1 / ratio(*(report.prediction.errors[name] for name in ("given", "improved")))
        told += "; together they leave %.0f%% of the prediction error" % (100 * left)
        if left > 1 / 2:
            told += ", and so much is still unexplained that other runs may show other effects"
    return told + "."


def _effect(report: DiagnosisReport, step: AddedEffect) -> str:
    """An effect that was found: "motor_lag - first-order lag of the thrusters: tau 50 ms (95%: 48 to 52 ms).
    Very certain."."""
    name, values = step.added, report.improved.parameters
    own = {key.split(".", 1)[1]: p for key, p in values.items() if key.startswith(name + ".")}
    means = " - " + report.means[name] if name in report.means else ""
    told = "%s%s: %s" % (name, means, ", ".join(words.parameters(own)))
    estimates = {
        key: effect_words.Estimate.of(p.value, p.ci95, p.unit, p.identified) for key, p in own.items()
    }
    does = effect_words.sentence(name, estimates)
    told += ", so that " + does if does else ""
    ends = _at_ends(report, name)
    told += ". The runs prefer a value beyond the range of " + listed(ends) if ends else ""
    if step.others:
        told += ". These runs do not distinguish it from %s" % words.effects(report, step.others)
    return "%s. %s." % (told, _certainty(report, step))


def _left(report: DiagnosisReport) -> str:
    """What the improved model leaves beyond what matters."""
    agrees, found = report.agreement, report.prediction
    if not agrees.holds or found is None:
        return words.pattern(report) + "."
    is_ = "comes from differences between runs, " if report.varies else "is "
    told = "the remaining error, %s, %sa random disturbance" % (off(found.errors["improved"]), is_)
    if not _is_chance(report):
        told += " or an effect of something unrecorded"
    return told + (": " + words.common(agrees.common) if agrees.common else "") + "."


def _is_chance(report: DiagnosisReport) -> bool:
    """Whether runs with the same commands show that more than half of the rest is a random disturbance."""
    found = report.agreement.common
    return bool(report.agreement.holds and found and found.low <= 0 and found.high < 1 / 2)


def _rest_matters(report: DiagnosisReport) -> bool:
    """Whether the improved model leaves more, beside what the mocap leaves, than what matters."""
    found, least = report.prediction, report.matters
    if found is None or least is None:
        return False
    if report.agreement.holds and not report.varies and found.disturbed and not is_pushed(found):
        return False  # the likelihood of the same poses sees no push
    error, mocap = found.errors["improved"], found.mocap
    return (
        error.position_mm**2 - mocap.position_mm**2 > least.position_mm**2
        or error.heading_deg**2 - mocap.heading_deg**2 > least.heading_deg**2
    )


def _certainty(report: DiagnosisReport, step: AddedEffect) -> str:
    """How certain an effect is, and the evidence against it."""
    held, fitted = step.judged.holdout, step.judged.fitted
    sure = _sure(max(step.p_corrected, step.p_interval))
    if report.changes:
        return "Seen, not confirmed: the craft changed during these runs"
    if held and held.is_worse:
        return "Contradicted by the runs that you held out: predictions of them are worse with it"
    if held and not held.is_better:
        return "%s in the fitted runs; the runs that you held out cannot confirm it" % sure
    if not fitted.is_better:
        return "Seen, not confirmed: the held-out parts of the runs cannot confirm it"
    if _predicts_as_well_without(report):
        return "Seen, not confirmed: a refit without effects predicts as well"
    if step.p_interval > DENIED:
        return "Seen, not confirmed: given the differences between runs, it may be zero"
    if _rest(report) or _at_ends(report, step.added):
        return sure + " that something acts like it"
    return sure + (" that one of these acts" if step.others else "")


def _predicts_as_well_without(report: DiagnosisReport) -> bool:
    """Whether the refitted model without effects predicts no worse than the improved one."""
    errors = report.prediction.errors if report.prediction else {}
    return "refitted" in errors and ratio(errors["improved"], errors["refitted"]) >= 1


def _at_ends(report: DiagnosisReport, name: str) -> List[str]:
    """Parameters of an effect of the library that are at an end of their range where the effect is not
    nothing."""
    values, known = report.improved.parameters, candidates.effects().get(name, {"parameters": []})
    own = [(p, values.get("%s.%s" % (name, p["name"]))) for p in known["parameters"]]
    return [p["name"] for p, found in own if found and found.at_bound and found.value != p["neutral"]]


def _rest(report: DiagnosisReport) -> str:
    """What is missing beside the effects found; empty if nothing is."""
    kind, matters, ceiling = report.verdict, _rest_matters(report), report.ceiling
    error = report.improved.error.heldout
    explained = error is not None and error < EXPLAINED * report.noise_floor
    depends = bool(ceiling.terms) and not report.agreement.frequency
    if kind == "complete" and matters:
        return "nothing that these runs show - " + _left(report)
    if kind == "complete" and not explained:
        return (
            "nothing that these runs show - the remaining error is a random disturbance, which no recorded "
            "quantity predicts."
        )
    if kind == "complete":
        small = [words.effect(report, one.effect) for one in report.dropped if one.change]
        acts = " There is a trace of %s, too small to matter." % listed(small) if small else ""
        return "nothing - the model predicts these runs as well as the mocap can measure them." + acts
    if kind == "varies":
        told = "no effect, but %s." % listed([words.varying(found) for found in report.varies])
        return told + (" " + capital(_left(report)) if matters else "")
    if kind == "undecided":
        return "cannot be decided, because " + _undecided(report, depends)
    if kind == "missing" and depends and not explained:
        told = "Something that depends on %s may also be missing; these runs cannot decide it."
        return told % words.arguments(report)
    if kind == "missing":
        doubted = not explained and not report.agreement.holds
        return "More may be missing: %s." % words.pattern(report) if doubted else ""
    unnamed = "that is not in the library"
    if report.selection:
        unnamed = "that is none of the effects tried (%s)" % report.selection
    what = "something else" if report.improved.effects else "an effect"
    if ceiling.named_as:
        return "%s %s: %s." % (what, unnamed, ceiling.named_as)
    return "%s %s and depends on %s." % (what, unnamed, words.arguments(report))


def _undecided(report: DiagnosisReport, depends: bool) -> str:
    """Why runs cannot decide whether something is missing. depends: they show what it may depend on."""
    if number(report.noise_floor) == "-":
        return "the model's motion is not finite over whole runs, so the noise floor is unknown."
    if report.agreement.frequency:
        return words.pattern(report) + "."
    refuted = [dropped for dropped in report.dropped if dropped.change is None]
    if refuted:
        best = words.effect(report, refuted[-1].effect)
        return "%s fits these runs best, but %s." % (best, refuted[-1].why)
    if depends:
        return "what they show about %s does not predict the other runs." % words.arguments(report)
    if not report.agreement.holds:
        return words.pattern(report) + "."
    if report.improved.by == "simulation" and not report.steps:
        return "the likelihood takes the rest for a random disturbance and predicts worse than another fit."
    told = "a random disturbance explains the rest as well as an effect of up to %.0f%% of it would."
    return told % float(100 * report.ceiling.bound)


def _corrected(report: DiagnosisReport, folder: str) -> str:
    """What to do with recordings of which no diagnosis is right; empty where there is none."""
    if report.verdict == "misread":
        anyway = "add --as-recorded" if folder else "give as_recorded=True"
        return "correct the mapping or the settings as stated above, or %s to diagnose anyway" % anyway
    for one in report.changes[:1]:
        return "%s: %s, and diagnose again" % (listed(one.runs), one.remedy)
    unit = unit_of_length(p.named(name) for name, p in report.improved.parameters.items())
    return "check the unit of the positions, and diagnose again: %s" % unit if unit else ""


def _next(report: DiagnosisReport, folder: str) -> str:
    """What to do next; commands stand on lines of their own."""
    kind, proposed = report.verdict, report.next_experiment
    corrected = _corrected(report, folder)
    if corrected:
        return corrected
    nameless, open_still = kind in ("unexplained", "memory"), kind == "missing" and bool(_rest(report))
    flies = proposed and (proposed.launch if folder else proposed.call or proposed.launch)
    if proposed and any(len(step.group) > 1 for step in report.steps):
        return "fly this to distinguish %s:\n%s" % (words.effects(report, proposed.separates), flies)
    if report.selection and (nameless or open_still or kind == "undecided"):
        whole = "ground.diagnose(%r, RECORDINGS)" % report.model
        if folder:
            model = shlex.quote(report.model)
            whole = "rosrun ground identify diagnose BAGS --model %s -o whole_library" % model
        return "try all effects of the library:\n" + whole
    if nameless and report.unexplained.proposal:
        adds = "ground.add(diagnosis.improved, diagnosis.proposal, RECORDINGS)"
        if folder:
            files = _in(folder, "proposal.yaml"), _in(folder, "improved.yaml")
            adds = "rosrun ground identify add %s BAGS --model %s -o proposed.yaml" % files
        return "the formula is a new effect; to add it and fit its size:\n" + adds
    if nameless:
        return "record more runs over the same places with other commands, so that a formula can be found"
    swings = report.agreement.frequency
    if swings and (kind == "undecided" or (kind != "varies" and _rest_matters(report))):
        return "switch off whatever swings or turns near the craft, one thing at a time, and record again"
    if kind == "undecided":
        return "record more and longer runs, over the same places, with other commands"
    judged = [one for step in report.steps for one in (step.judged.fitted, step.judged.holdout)]
    is_open = any(one is not None and not one.is_better for one in judged)
    is_open |= any(step.p_interval > DENIED for step in report.steps)
    if is_open or (report.steps and _predicts_as_well_without(report)):
        return "record more runs and diagnose all of them together, to confirm or refute it"
    if open_still:
        return "record more and longer runs to see whether more is missing; the model is usable now"
    if report.varies:
        return "find what changed between the runs (battery, trim, floor), or accept their spread"
    if kind in ("complete", "missing") and _rest_matters(report) and not _is_chance(report):
        return _repeat(report, " (roslaunch: returns:=false)" if folder else "")
    model = _in(folder, "improved.yaml") if folder else "diagnosis.improved"
    told = "nothing needed; controllers and the simulator accept %s" % model
    if proposed:
        hidden = words.effects(report, proposed.separates[:1])
        return "%s. These runs cannot show %s; to test it:\n%s" % (told, hidden, flies)
    return told


def _repeat(report: DiagnosisReport, by: str) -> str:
    """The flights that show whether the remaining error is chance; by: how they are flown."""
    if report.agreement.common:
        return "fly the same commands more often, and diagnose all runs: their common part is not yet clear"
    return (
        "fly the same commands twice from the same start%s, and diagnose both runs with these: a random "
        "disturbance leaves different errors in the two, a missing effect the same ones" % by
    )
