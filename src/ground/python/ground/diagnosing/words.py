"""The report of a diagnosis (contents of diagnosis.json) in sentences."""

import math
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple

from ground.analysis.diagnosis import EXPLAINED
from ground.analysis.formula_words import WORDS, quantity
from ground.recordings import suspicions
from ground.reports.words import capital, listed, number
from ground.support.annotations import Document

MIN_SHARE = 0.05  # share of the squared error from which a random wrench is reported
MIN_ROOM = 0.3  # part of the random wrench's force from which a force in the room is reported
MIN_ARGUMENT = 0.1  # least share of an argument that is named


def effect(report: Document, name: str) -> str:
    """An effect of a diagnosis in words with its name beside: "moving air (wind)". Names of a user's
    own effects, and of parameters, stay alone."""
    means = report["means"].get(name)
    return "%s (%s)" % (means, name) if means else name


def effects(report: Document, names: Sequence[str]) -> str:
    """Some effects of a diagnosis in words."""
    return listed([effect(report, name) for name in names])


def steps(report: Document) -> List[Tuple[str, float]]:
    """The steps of a diagnosis and the error after each, as error_name says: a list of pairs."""
    found = [("refitted as it is", report["nominal"]["error"]["heldout"])]
    return found + [("+ " + effect(report, s["added"]), s["error"]["heldout"]) for s in report["steps"]]


def is_held_out(report: Document) -> bool:
    """Whether the user held out runs."""
    return bool(report["runs"]["heldout"] != report["runs"]["fit"])


def error_name(report: Document) -> str:
    """What the errors of a diagnosis are measured on."""
    return "error on held-out runs" if is_held_out(report) else "cross-validated error"


def verdict(report: Document) -> str:
    """The verdict of a diagnosis in one sentence, and what does not confirm it in others."""
    return " ".join([_verdict(report), *_unconfirmed(report)])


def _verdict(report: Document) -> str:
    kind, names = report["verdict"], report["improved"]["effects"]
    if kind == "misread":
        return (
            "The recordings look misread, so no effect is blamed: mend them first, or diagnose them as they "
            "are with --as-recorded."
        )
    before, after = (report[model]["error"]["heldout"] for model in ("nominal", "improved"))
    falls = "falls" if after < before else "does not fall: it goes"
    one, chosen = len(names) == 1, capital(effects(report, names))
    it = "with %s the %s %s from %.3f to %.3f" % (
        "it" if one else "them", error_name(report), falls, before, after,
    )  # fmt: skip
    leaves = "the noise of the poses alone leaves %.3f." % report["noise_floor"]
    now = "the %s is %.3f, %s" % (error_name(report), after, leaves)
    if kind == "complete" and after < EXPLAINED * report["noise_floor"]:
        return "Nothing is missing: refitted, %s" % now
    if kind == "complete":
        rest = "The rest is a random push, which nothing that was recorded predicts."
        return "Nothing is missing that these runs could teach: refitted, %s %s" % (now, rest)
    if kind == "varies":
        return "No effect is missing, but %s; %s" % (listed([_varying(v) for v in report["varies"]]), now)
    if kind == "missing":
        return "%s missing: %s; %s%s" % (chosen + (" is" if one else " are"), it, leaves, _more(report))
    if kind == "undecided" and names:
        return (
            "These runs cannot decide what is missing: %s suit%s them, but %s, and what is left is no steady "
            "random push; %s Record more runs, or look for what acts at some times or places only."
        ) % (effects(report, names), "s" * one, it, leaves)
    if kind == "undecided":
        return "These runs cannot decide whether something is missing: %s %s" % (now, _undecided(report))
    rest = "missing that depends on %s and has no name in the library" % arguments(report)
    if report["ceiling"]["named_as"]:
        rest += " (%s)" % report["ceiling"]["named_as"]
    if not names:
        return "Something is %s: %s" % (rest, now)
    improves = chosen + (" improves" if one else " improve")
    return "%s the model: %s. But something else is %s: %s" % (improves, it, rest, leaves)


def _more(report: Document) -> str:
    """That more may be missing beside effects that were found; empty if nothing says so."""
    if report["improved"]["error"]["heldout"] < EXPLAINED * report["noise_floor"]:
        return ""
    if report["ceiling"]["terms"]:
        return " More may be missing that depends on %s; these runs cannot decide it." % arguments(report)
    return (
        "" if report["agreement"]["holds"] else " More may be missing: what is left is no steady random push."
    )


def _undecided(report: Document) -> str:
    """Why runs cannot decide whether something is missing, and what to do."""
    found = report["ceiling"]
    if found["terms"]:
        return (
            "What these runs teach of its dependence on %s does not predict other runs: record more, with "
            "other commands, over the same places." % arguments(report)
        )
    if not report["agreement"]["holds"]:
        return (
            "What is left acts at some times or places only: record more runs over the same places, or look "
            "for a draught, a cable or a bad patch of floor."
        )
    if any(dropped["change"] is None for dropped in report["dropped"]):
        return "Effects that fit these runs do not predict the others: record more runs, with other commands."
    return (
        "A random push explains it as well as a smooth function of what was recorded (up to %.0f%% of it): "
        "record more and longer runs over the same places." % (100 * found["bound"])
    )


def _unconfirmed(report: Document) -> Iterator[str]:
    """Effects that held-out data contradict or cannot confirm."""
    for step in report["steps"]:
        name, judged = effect(report, step["added"]), step["judged"]
        held, fitted = judged["holdout"], judged["fitted"]
        if held and held["verdict"] != "better":
            does = "contradict" if held["verdict"] == "worse" else "cannot confirm"
            yield "The held-out runs %s %s (%s)." % (does, name, _risen(held))
        if fitted["verdict"] != "better":
            yield (
                "%s is certain by its likelihood, but cross-validation of the runs fitted to cannot confirm "
                "it (%s)." % (capital(name), _risen(fitted))
            )


def _risen(found: Document) -> str:
    """A comparison: "log-likelihood +12.3 +-4.1, error -0.012 +-0.004"."""
    values = found["gain"], found["gain_error"], found["rise"], found["rise_error"]
    return "log-likelihood %+.1f +-%.1f, error %+.3f +-%.3f" % tuple(
        math.nan if value is None else value for value in values
    )


def findings(report: Document) -> List[str]:
    """Mistakes that the recordings look like, each with its evidence and the option that mends it."""
    return ["%s: %s" % (", ".join(f["runs"]), suspicions.sentence(f)) for f in report["findings"]]


def _varying(found: Document) -> str:
    """A difference: "the yaw moment differs between runs (sd 9.1e-05 N m)"."""
    size = quantity(found["deviation"], found["unit"], 2)
    return "the %s differs between runs (sd %s)" % (found["parameter"], size)


def parameters(values: Mapping[str, Document]) -> Iterator[str]:
    """A line for each parameter of an effect."""
    for name, p in values.items():
        if p["identified"]:
            low, high = p["ci95"]  # None in JSON: infinite
            low, high = -math.inf if low is None else low, math.inf if high is None else high
            yield "%s %.4g %s [%.4g, %.4g]" % (name, p["value"], p["unit"], low, high)
        else:
            yield "%s: not identifiable from these data" % name


def apart(report: Document) -> Iterator[str]:
    """What these runs do not distinguish, and the experiment that would."""
    for c in report["candidates"]:
        if not c["seen"]:
            others = effects(report, c["group"][1:])
            why = (
                "other values of %s have the same effect" % others if others else "it changes nothing on them"
            )
            yield "These runs cannot show %s: %s." % (effect(report, c["effect"]), why)
    for step in report["steps"]:
        others = effects(report, [name for name in step["group"] if name != step["added"]])
        if others:
            yield "These runs cannot distinguish %s from %s." % (effect(report, step["added"]), others)
    proposed = report["next_experiment"]
    if proposed:
        named = effects(report, proposed["separates"])
        yield (
            "To %s %s, record%s: %s. In %s one such run sets the models %.1f standard "
            "deviations apart: %s (to simulate it first: identify simulate %s)"
            % (
                "distinguish" if len(proposed["separates"]) > 1 else "show",
                named,
                " %d runs" % proposed["repeat"] if proposed["repeat"] > 1 else "",
                proposed["input"],
                "the room %s" % proposed["room"] if proposed["room"] else "a room of 4 x 4 m",
                proposed["expected_disagreement"],
                proposed["launch"],
                proposed["arguments"],
            )
        )


def arguments(report: Document) -> str:
    """What the learnable part depends on, in words."""
    shares = report["ceiling"]["arguments"]
    most = max(shares.values(), default=0.0)
    named = [WORDS[name] for name, share in shares.items() if share >= MIN_ARGUMENT * most]
    return listed(named) if named else "what was recorded"


def _part(share: Document) -> str:
    """A share with its 95% interval."""
    low, high = (100 * max(0.0, min(1.0, end)) for end in share["ci95"])
    return "%.0f%% (%.0f to %.0f%%)" % (100 * max(0.0, share["share"]), low, high)


def ceiling(report: Document) -> str:
    """How much of the error is named, how much could be learned, and how much is chance."""
    found, agrees, named = report["ceiling"], report["agreement"], bool(report["improved"]["effects"])
    parts = ["named %s" % _part(found["named"])] * named
    parts += ["%s %s" % (kind, _part(found[kind])) for kind in ("learnable", "chance")]
    text = "Of the squared error on runs not fitted to: %s" % listed(parts)
    text += "; the learnable part depends on %s." % arguments(report) if found["said"] else "."
    poses = found["poses"]
    if poses:
        known = [("before", "without effects")] * named + [("now", "with the model")]
        known += [("after", "with the formula for what is left")] * bool(found["named_as"])
        text += " Poses predicted %.2g s ahead are off by %s (noise of a pose: %.2g mm, %.2g deg)." % (
            poses["seconds"],
            listed(["%.3g mm and %.0f deg %s" % (*poses[key], what) for key, what in known]),
            *poses["noise"],
        )
    if not agrees["holds"]:
        text += (
            " What is left is not the random push that the model claims: the error is %(measured).3f, and "
            "that push leaves %(expected).3f." % agrees["error"]
        )
    return text


def crossed(report: Document) -> str:
    """Cross-validated error beside that on runs that the user held out."""
    return (
        "The cross-validated error of the runs fitted to, each by a fit to the others, is %s without further "
        "effects and %s with those found."
        % tuple(number(report[kind]["cross_validated"]) for kind in ("nominal", "improved"))
    )


def bands(report: Document) -> Iterator[str]:
    """Coverage of the prediction bands of the improved model."""
    shares: Dict[float, List[float]] = {}  # of x, y and heading, by horizon [s]
    for band in report["bands"]:
        if band["channel"] in ("x", "y", "psi"):
            shares.setdefault(band["horizon"], []).append(band["coverage"])
    if shares:
        yield "90%% prediction bands hold on held-out runs, of the poses: %s" % ", ".join(
            "%.0f%% after %.1f s" % (100 * sum(found) / len(found), h) for h, found in shares.items()
        )


def left(report: Document) -> Iterator[str]:
    """What the grown model leaves: differences between runs, dropped effects, the disturbance."""
    for found in report["varies"] if report["verdict"] != "varies" else ():
        yield capital(_varying(found)) + "."
    for found in report["dropped"]:
        name, why = capital(effect(report, found["effect"])), found["why"]
        if found["change"]:
            why += (
                ": after %(seconds).2g s it moves the predicted pose by %(position_mm).2g mm and "
                "%(heading_deg).2g deg, %(relative).1f times the noise of a pose" % found["change"]
            )
        yield "%s (p %.1g) was not added: %s." % (name, found["p_value"], why)
    error = report["agreement"]["error"]
    if error["expected"] ** 2 - error["noise"] ** 2 < MIN_SHARE * error["measured"] ** 2:
        return  # levels this low are determined by their priors, not by the data
    levels = report["disturbance"]
    pushes = [
        "%s %.2g %s over %.2g s" % (c, levels["sigma_" + c], unit, levels["time_" + c])
        for c, unit in (("X", "N"), ("Y", "N"), ("N", "N m"))
    ]
    yield (
        "Beside the model a random wrench acts: %s (standard deviations and correlation times)."
        % ", ".join(pushes)
    )
    if levels["sigma_room"] > MIN_ROOM * max(levels["sigma_X"], levels["sigma_Y"]):
        yield (
            "A random force of %s keeps its direction in the room while the craft turns, for about "
            "%.2g s, as a draught does." % (quantity(levels["sigma_room"], "N", 2), levels["time_room"])
        )


def unexplained(report: Document) -> Iterator[str]:
    """An effect that would lower what is left."""
    proposal = report["unexplained"]["proposal"]
    if proposal:
        values = ["%s = %.4g %s" % (n, p["value"], p["unit"]) for n, p in proposal["parameters"].items()]
        terms = ["%s = %s" % item for item in proposal["expression"].items()]
        yield (
            "%s would lower the cross-validated error to %.3f (%s with %s). It is in proposal.yaml, ready "
            "for identify add."
            % (
                capital(proposal.get("means", "a term")),
                proposal["error"]["heldout"],
                "; ".join(terms),
                ", ".join(values),
            )
        )


def extent(report: Document) -> Iterator[str]:
    """How much of the data was used, if not all."""
    count = report["windows"]
    if count["used"] < count["available"]:
        yield ("used %d of %d windows, spread evenly over the runs" % (count["used"], count["available"]))


def concluded(report: Document) -> Iterator[str]:
    """The first lines that the terminal prints for a diagnosis; they need what the verdict needs."""
    yield verdict(report)
    yield from findings(report)


def described(report: Document) -> Iterator[str]:
    """The rest of these lines."""
    if report["verdict"] == "misread":
        return
    yield ceiling(report)
    yield from bands(report)
    yield ""
    form = "%4s %9s %9s %9s  %s"
    yield form % ("rank", "p", "dBIC", "crossed", "effect: parameters [95%]")
    alone = number(report["nominal"]["cross_validated"])
    yield form % ("-", "-", "-", alone, "none, refitted by likelihood as all below")
    for c in report["candidates"][:8]:
        name = "* " * c["selected"] + effect(report, c["effect"])
        values = "; ".join(parameters(c["parameters"]))
        numbers = "%.1g" % c["p_value"], "%.0f" % c["delta_bic"], number(c["error"]["heldout"])
        yield form % (c["rank"], *numbers, "%s: %s" % (name, values))
    for i, (what, error) in enumerate(steps(report)):
        yield "%-23s %5.3f %s" % ("" if i else error_name(report) + ":", error, what)
    yield "%29.3f noise of the poses alone" % report["noise_floor"]
    if is_held_out(report):
        yield crossed(report)
    for lines in (extent, left, apart, unexplained):
        yield from lines(report)
