"""Results of a comparison or a diagnosis, in sentences."""

import math
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

from ground.analysis import missing_wrench
from ground.analysis.formula_words import WORDS, quantity
from ground.annotations import Document
from ground.recordings import suspicions
from ground.recordings.windows import WINDOW

PLACES = {"ahead": "ahead", "starboard": "to starboard", "heading": "in heading"}
MIN_SHARE = 0.05  # share of the squared error from which a random wrench is reported
ABOVE = 1.15  # ratio of error to noise floor from which more may be missing
MIN_ROOM = 0.3  # part of the random wrench's force from which a force in the room is reported
FITTED = {"likelihood": "", "simulation": " by simulation error"}  # by what a model was refitted
ERRORS = {"u": "surge u", "v": "sway v", "r": "yaw rate r"}


def number(value: Optional[float]) -> str:
    """Three digits after the point; "-" for None."""
    return "-" if value is None else "%.3f" % value


def effect(report: Document, name: str) -> str:
    """An effect of a diagnosis in words with its name beside: "moving air (wind)". Names of a user's
    own effects, and of parameters, stay alone."""
    means = report["means"].get(name)
    return "%s (%s)" % (means, name) if means else name


def effects(report: Document, names: Sequence[str]) -> str:
    """Some effects of a diagnosis in words."""
    return listed([effect(report, name) for name in names])


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def sentence(text: str) -> str:
    """A text with a capital letter and a full stop."""
    return _capital(text.strip()) + ("" if text.rstrip().endswith((".", "!", "?")) else ".")


def summary(
    numbers: Document, correlation: Document, missing: Document, commands: Mapping[str, str]
) -> List[str]:
    """A few sentences: the missing wrench, residuals, the error. commands: names of what the residuals are
    correlated with."""
    found = []
    if missing["disturbances"]:
        found.append(disturbances(missing["disturbances"]))
    found.append(largest_missing(missing["channels"]))
    followed = followed_input(correlation["channels"], commands)
    if followed:
        found.append(followed)
    found.append(error(numbers["error_by_channel"]))
    return found


def disturbances(events: Sequence[Document]) -> str:
    """The spans of time that were left out."""
    spans = ", ".join("%.1f to %.1f" % (e["start"], e["end"]) for e in events)
    return (
        "left out of what follows, because no input explains the motion (contact, hand, wrong poses): "
        "%s s" % spans
    )


def largest_missing(channels: Document) -> str:
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


def followed_input(channels: Document, commands: Mapping[str, str]) -> Optional[str]:
    """The command that the residuals follow most, and with which delay; None without one."""
    strongest, text = 0.0, None
    for channel, entry in channels.items():
        for kind, name in commands.items():
            if entry[kind] is None or entry[kind]["accepted"]:
                continue
            after = [i for i, lag in enumerate(entry[kind]["lag_seconds"]) if lag > -1e-9]
            at = max(after, key=lambda i: float(abs(entry[kind]["value"][i])))
            value = entry[kind]["value"][at]
            if abs(value) > max(strongest, entry[kind]["band99"][at]):
                strongest = abs(value)
                late = 1e3 * entry[kind]["lag_seconds"][at]
                when = "at once" if late < 1 else "%.0f ms after it" % late
                text = "one-step residuals of the motion %s still follow %s, most %s (correlation %.2f)" % (
                    PLACES[channel],
                    name,
                    when,
                    value,
                )
    return text


def error(by_channel: Dict[str, float]) -> str:
    """The channel with the largest part of the error."""
    name = max(by_channel, key=by_channel.__getitem__)
    share = by_channel[name] / max(1e-300, sum(by_channel.values()))
    return "%.0f%% of the error is in the %s" % (100 * share, ERRORS[name])


def off_after_a_second(numbers: Document) -> str:
    """Median error of a prediction after a second; "-" where no run is that long."""
    after = next(h for h in numbers["horizons"] if h["seconds"] == 1.0)
    if not after["starts"]:
        return "-"
    return "%.0f mm %.0f deg" % (after["position_mm"]["median"], after["heading_deg"]["median"])


def comparison(ranking: Document, noise_floor: float) -> str:
    """One sentence on the error of the models compared: which predicts best, or that errors do not say so
    because models were fitted to the runs."""
    errors, held_out = ranking["errors"], ranking["role"] == "held_out"
    (best, least), *others = errors.items()
    text = "%s has an error of %.3f" % (best, least)
    if others:
        text = "%s %s best: its error is %.3f, that of %s" % (
            best,
            "predicts" if held_out else "fits",
            least,
            listed(["%s %.3f" % other for other in others]),
        )
    floor = "the noise of the poses alone would leave %.3f." % noise_floor
    return "%s; %s%s" % (text, floor, "" if held_out else " " + _used(ranking))


def _used(ranking: Document) -> str:
    """What errors on runs that models were fitted to do not say."""
    names = listed(ranking["fitted"])
    if ranking["role"] == "unknown":
        return (
            "Whether %s was fitted to these data is not known, because the file of an older version has only "
            "names of recordings: fit again, or compare on new recordings." % names
        )
    were = "These runs were" if len(ranking["runs"]) > 1 else "This run was"
    what = "which model predicts better" if len(ranking["errors"]) > 1 else "how well it predicts"
    return "%s used for fitting %s: compare on other recordings to learn %s." % (were, names, what)


def listed(names: List[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + names[-1:])


def steps(report: Document) -> List[Tuple[str, float]]:
    """The steps of a diagnosis and the error after each, as error_name says: a list of pairs."""
    nominal = report["nominal"]
    found = [("refitted as it is" + FITTED[nominal["by"]], nominal["error"]["heldout"])]
    if nominal["by"] != "likelihood" and len(report["steps"]) > 1:
        # models between the first and the last were refitted by likelihood
        found.append(("refitted by likelihood", nominal["refits"]["likelihood"]["heldout"]))
    found += [("+ " + effect(report, step["added"]), step["error"]["heldout"]) for step in report["steps"]]
    return found


def verdict(report: Document) -> str:
    """The verdict of a diagnosis in one sentence, and what does not confirm it in others."""
    return " ".join([_verdict(report), *_unconfirmed(report)])


def _verdict(report: Document) -> str:
    names = report["improved"]["effects"]
    one, chosen = len(names) == 1, _capital(effects(report, names))
    fall = _fall(report, "it" if one else "them")
    leaves = "the noise of the poses alone leaves %.3f." % report["noise_floor"]
    if report["verdict"] == "misread":
        return (
            "The recordings look misread, so no effect is blamed: mend them first, or diagnose them as they "
            "are with --as-recorded."
        )
    if report["verdict"] == "complete":
        small = report["slight"]
        visible = "; %s is visible and does not matter" % _sized(report, small) if small else ""
        there = "refitted, the model's %s is %s, and %s" % (error_name(report), _without(report), leaves)
        if report["improved"]["error"]["heldout"] < ABOVE * report["noise_floor"]:
            return "Nothing is missing%s: %s" % (visible, there)
        return (
            "Nothing is missing that these runs could teach%s: %s The rest is a random push, which nothing "
            "that was recorded predicts." % (visible, there)
        )
    if report["verdict"] == "varies":
        return "No effect is missing, but %s; the %s is %s, %s" % (
            listed([_varying(v) for v in report["varies"]]),
            error_name(report),
            _without(report),
            leaves,
        )
    if report["verdict"] == "missing":
        said = "%s missing: %s; %s" % (chosen + (" is" if one else " are"), fall, leaves)
        return said + _more(report)
    if report["verdict"] == "undecided":
        return _undecided(report)
    rest = "missing that depends on %s and has no name in the library" % arguments(report)
    if report["ceiling"]["named_as"]:
        rest += " (%s)" % report["ceiling"]["named_as"]
    if not names:
        there = error_name(report)
        return "Something is %s: the %s is %s, %s" % (rest, there, _without(report), leaves)
    improves = chosen + (" improves" if one else " improve")
    return "%s the model: %s. But something else is %s: %s" % (improves, fall, rest, leaves)


def _more(report: Document) -> str:
    """That more may be missing beside effects that were found; empty if nothing says so."""
    if report["improved"]["error"]["heldout"] < ABOVE * report["noise_floor"]:
        return ""
    if report["ceiling"]["terms"]:
        return (
            " More may be missing that depends on %s: these runs cannot decide, because what they teach "
            "of it does not predict other runs well." % arguments(report)
        )
    if not report["agreement"]["holds"]:
        return " More may be missing: what is left is no steady random push."
    return ""


def _undecided(report: Document) -> str:
    """Why runs cannot decide whether something is missing."""
    found, agrees = report["ceiling"], report["agreement"]
    leaves = "the error on held-out runs is %s, the noise of the poses alone leaves %.3f" % (
        _without(report),
        report["noise_floor"],
    )
    if report["improved"]["effects"]:
        names = report["improved"]["effects"]
        return (
            "These runs cannot decide what is missing: %s suit%s them, but %s, and what is left is no steady "
            "random push; %s. Record more runs, or look for what acts at some times or places only."
        ) % (
            effects(report, names),
            "s" if len(names) == 1 else "",
            _fall(report, "it" if len(names) == 1 else "them"),
            "the noise of the poses alone leaves %.3f" % report["noise_floor"],
        )
    if found["terms"]:
        why = (
            "it depends on %s, but what these runs teach of that does not predict other runs: record more "
            "runs, with other commands, over the same places" % arguments(report)
        )
    elif not agrees["holds"]:
        why = (
            "what is left is no steady random push: it acts at some times or places only. Record more runs "
            "over the same places, or look for a draught, a cable or a bad patch of floor"
        )
    elif report["dropped"]:
        why = "effects that fit these runs do not predict the others: record more runs, with other commands"
    else:
        why = (
            "a random push explains it as well as a smooth function of what was recorded (up to %.0f%% of "
            "it). Record more runs, longer ones and over the same places" % (100 * found["bound"])
        )
    return "These runs cannot decide whether something is missing: %s; %s." % (leaves, why)


def _fall(report: Document, them: str) -> str:
    """How the error changes from the best refit without the effects to the improved model."""
    before, after = (report[kind]["error"]["heldout"] for kind in ("nominal", "improved"))
    changes = "falls" if after < before else "does not fall: it goes"
    return "with %s the %s %s from %.3f to %.3f" % (them, error_name(report), changes, before, after)


def is_held_out(report: Document) -> bool:
    """Whether the user held out runs."""
    return bool(report["runs"]["heldout"] != report["runs"]["fit"])


def error_name(report: Document) -> str:
    """What the errors of a diagnosis are measured on."""
    return "error on held-out runs" if is_held_out(report) else "cross-validated error"


def _without(report: Document) -> str:
    """The error of the model that is written where no effect is missing; the other refit is named if
    it predicts better."""
    best, written = report["nominal"]["error"]["heldout"], report["improved"]["error"]["heldout"]
    if number(best) == number(written):
        return number(written)
    return "%s (%s refitted%s)" % (number(written), number(best), FITTED[report["nominal"]["by"]])


def _unconfirmed(report: Document) -> Iterator[str]:
    """Effects that held-out data contradict or cannot confirm."""
    judged = {step["added"]: step["judged"] for step in report["steps"]}
    by_user = {name: found["holdout"] for name, found in judged.items() if found["holdout"]}
    for name, found in by_user.items():
        if found["verdict"] == "better":
            continue
        is_worse = found["verdict"] == "worse"
        yield "%s %s (%s)." % (
            "But the held-out runs contradict" if is_worse else "The held-out runs cannot confirm",
            effect(report, name),
            _risen(found),
        )
    for name, found in judged.items():
        if found["fitted"]["verdict"] != "better":
            yield (
                "%s is certain by its likelihood, but cross-validation of the runs fitted to cannot confirm "
                "it (%s)." % (_capital(effect(report, name)), _risen(found["fitted"]))
            )


def _risen(found: Document) -> str:
    """A comparison: "log-likelihood +12.3 +-4.1, error -0.012 +-0.004"."""
    values = found["gain"], found["gain_error"], found["rise"], found["rise_error"]
    return "log-likelihood %+.1f +-%.1f, error %+.3f +-%.3f" % tuple(
        math.nan if value is None else value for value in values
    )


def findings(report: Document) -> Iterator[str]:
    """Mistakes that the recordings look like, each with its evidence and the option that mends it."""
    for found in report["findings"]:
        yield "%s: %s" % (", ".join(found["runs"]), suspicions.sentence(found))


def _varying(found: Document) -> str:
    """A difference: "the yaw moment differs between runs (sd 9.1e-05 N m)"."""
    size = quantity(found["deviation"], found["unit"], 2)
    return "the %s differs between runs (sd %s)" % (found["parameter"], size)


def _sized(report: Document, found: Document) -> str:
    """An effect with the values of its parameters: "moving air (wind), wx 0.3 m/s"."""
    values = ["%s %s" % (n, quantity(p["value"], p["unit"], 2)) for n, p in found["parameters"].items()]
    return ", ".join([effect(report, found["effect"])] + values)


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
            others = c["group"][1:]
            yield "These runs cannot show %s: %s." % (
                effect(report, c["effect"]),
                (
                    "other values of %s have the same effect" % effects(report, others)
                    if others
                    else "it changes nothing on them"
                ),
            )
    for step in report["steps"]:
        others = [name for name in step.get("group", []) if name != step.get("added")]
        if others:
            yield "These runs cannot distinguish %s from %s." % (
                effect(report, step["added"]),
                effects(report, others),
            )
    proposed = report["next_experiment"]
    if proposed:
        yield (
            "To %s, record%s: %s. In %s one such run sets the models %.1f standard "
            "deviations apart: %s (to simulate it first: identify simulate %s)"
            % (
                (
                    "distinguish %s" % effects(report, proposed["separates"])
                    if len(proposed["separates"]) > 1
                    else "show " + effect(report, proposed["separates"][0])
                ),
                " %d runs" % proposed["repeat"] if proposed["repeat"] > 1 else "",
                proposed["input"],
                "the room %s" % proposed["room"] if proposed["room"] else "a room of 4 x 4 m",
                proposed["expected_disagreement"],
                proposed["launch"],
                proposed["arguments"],
            )
        )


MIN_ARGUMENT = 0.1  # least share of an argument that is named


def arguments(report: Document) -> str:
    """What the learnable part depends on, in words."""
    shares = report["ceiling"]["arguments"]
    most = max(shares.values(), default=0.0)
    named = [WORDS[name] for name, share in shares.items() if share >= MIN_ARGUMENT * most]
    return listed(named) if named else "what was recorded"


def part(share: Document) -> str:
    """A share with its 95% interval."""
    low, high = (100 * max(0.0, min(1.0, end)) for end in share["ci95"])
    return "%.0f%% (%.0f to %.0f%%)" % (100 * max(0.0, share["share"]), low, high)


def slight(report: Document) -> Iterator[str]:
    """An effect that is visible but too small to be called missing."""
    found = report["slight"]
    if found:
        yield (
            "%s is visible (%s; p %.1g) and too small to matter: after %.2g s it moves the predicted pose by "
            "%.2g mm and %.2g deg, %.1f times the noise of a pose."
            % (
                _capital(effect(report, found["effect"])),
                "; ".join(parameters(found["parameters"])),
                found["p_value"],
                found["change"]["seconds"],
                found["change"]["position_mm"],
                found["change"]["heading_deg"],
                found["change"]["relative"],
            )
        )


def ceiling(report: Document) -> str:
    """How much of the error is named, how much could be learned, and how much is chance."""
    found, agrees = report["ceiling"], report["agreement"]
    sentence = "Of the squared error on runs not fitted to: %s" % listed(
        ["named %s" % part(found["named"])] * bool(report["improved"]["effects"])
        + ["learnable %s" % part(found["learnable"]), "chance %s" % part(found["chance"])]
    )
    if found["said"]:
        sentence += "; the learnable part depends on %s" % arguments(report)
    sentence += "."
    if found["poses"]:
        poses = found["poses"]
        steps = [("before", "without effects")] * bool(report["improved"]["effects"])
        steps += [("now", "with the model")]
        steps += [("after", "with the formula for what is left")] * bool(found["named_as"])
        off = ["%.3g mm and %.0f deg %s" % (*poses[key], what) for key, what in steps]
        sentence += " Poses predicted %.2g s ahead are off by %s (noise of a pose: %.2g mm, %.2g deg)." % (
            poses["seconds"],
            listed(off),
            *poses["noise"],
        )
    if not agrees["holds"]:
        error = agrees["error"]
        worst = max(agrees["deviations"], key=lambda name: float(agrees["deviations"][name]))
        sentence += " What is left is not the random push that the model claims: " + (
            "the error is %.3f where that push leaves %.3f." % (error["measured"], error["expected"])
            if worst == "error"
            else "it is much stronger at some times."
        )
    return sentence


def crossed(report: Document) -> str:
    """Cross-validated error beside that on runs that the user held out."""
    return (
        "The cross-validated error of the runs fitted to, each by a fit to the others, is %s without further "
        "effects and %s with those found."
        % tuple(number(report[kind]["cross_validated"]) for kind in ("nominal", "improved"))
    )


def bands(report: Document) -> Optional[str]:
    """Accuracy of the improved model's predictions and coverage of its bands; None without bands."""
    poses = _held_poses(report)
    if not poses:
        return None
    at = max(h for h in poses if h <= WINDOW)
    sd = {b["channel"]: b["sd"] for b in report["bands"] if b["horizon"] == at}
    heading = math.degrees(sd["psi"])
    return (
        "On held-out runs, 90%% prediction bands of the improved model hold %s of the measured "
        "positions and headings; the standard deviation after %.1f s is %s and %s."
        % (
            listed(["%.0f%% after %.1f s" % (100 * share, h) for h, share in poses.items()]),
            at,
            quantity(math.hypot(sd["x"], sd["y"]) / math.sqrt(2), "m", 2),
            ("%.2g deg" if heading < 10 else "%.0f deg") % heading,
        )
    )


def _held_poses(report: Document) -> Dict[float, float]:
    """Share of x, y and heading that the bands hold, by horizon [s]."""
    shares: Dict[float, List[float]] = {}
    for band in report["bands"]:
        if band["channel"] in ("x", "y", "psi"):
            shares.setdefault(band["horizon"], []).append(band["coverage"])
    return {horizon: sum(found) / len(found) for horizon, found in shares.items()}


def left(report: Document) -> Iterator[str]:
    """What the grown model leaves: differences between runs, dropped effects, the disturbance."""
    for found in report["varies"] if report["verdict"] != "varies" else ():
        yield _capital(_varying(found)) + "."
    for found in report["dropped"]:
        yield "%s (p %.1g) was not added: %s." % (
            _capital(effect(report, found["effect"])),
            found["p_value"],
            found["why"],
        )
    error = report["agreement"]["error"]
    if error["expected"] ** 2 - error["noise"] ** 2 < MIN_SHARE * error["measured"] ** 2:
        return  # levels this low are determined by their priors, not by the data
    levels = report["disturbance"]
    yield (
        "Beside the model a random wrench acts: X %s over %.2g s, Y %s over %.2g s, N %s over %.2g s "
        "(standard deviations and correlation times of its slow part)."
        % tuple(
            part
            for c, unit in (("X", "N"), ("Y", "N"), ("N", "N m"))
            for part in ("%.2g %s" % (levels["sigma"][c], unit), levels["time"][c])
        )
    )
    room, sizes = levels["room"], levels["sigma"]
    if room["sigma"] > MIN_ROOM * max(sizes["X"], sizes["Y"]):
        yield (
            "A random force of %s keeps its direction in the room while the craft turns, for about "
            "%.2g s, as a draught does." % (quantity(room["sigma"], "N", 2), room["time"])
        )


def unexplained(report: Document) -> Iterator[str]:
    """An effect that would lower what is left."""
    rest = report["unexplained"]
    proposal = rest["proposal"]
    if proposal:
        values = ["%s = %.4g %s" % (n, p["value"], p["unit"]) for n, p in proposal["parameters"].items()]
        terms = ["%s = %s" % item for item in proposal["expression"].items()]
        yield (
            "%s would lower the cross-validated error to %.3f (%s with %s). It is in proposal.yaml, ready "
            "for identify add."
            % (
                _capital(proposal.get("means", "a term")),
                proposal["error"]["heldout"],
                "; ".join(terms),
                ", ".join(values),
            )
        )


def extent(report: Document) -> Iterator[str]:
    """How much of the data was used, if not all."""
    count = report["windows"]
    if count["used"] < count["available"]:
        yield (
            "used %d of %d windows, spread evenly over the runs; --thorough uses all"
            % (count["used"], count["available"])
        )


def concluded(report: Document) -> Iterator[str]:
    """The first lines that the terminal prints for a diagnosis; they need what the verdict needs."""
    yield verdict(report)
    yield from findings(report)


def described(report: Document) -> Iterator[str]:
    """The rest of these lines."""
    if report["verdict"] == "misread":
        return
    yield ceiling(report)
    poses = _held_poses(report)
    if poses:
        yield "90%% prediction bands hold on held-out runs, of the poses: %s" % ", ".join(
            "%.0f%% after %.1f s" % (100 * share, h) for h, share in poses.items()
        )
    yield ""
    yield "%4s %9s %9s %9s  %s" % ("rank", "p", "dBIC", "crossed", "effect: parameters [95%]")
    alone = number(report["nominal"]["cross_validated"])
    yield "%4s %9s %9s %9s  %s" % ("-", "-", "-", alone, "none, refitted by likelihood as all below")
    for c in report["candidates"][:8]:
        yield "%4d %9.1g %9.0f %9s  %s%s: %s" % (
            c["rank"],
            c["p_value"],
            c["delta_bic"],
            number(c["error"]["heldout"]),
            "* " if c["selected"] else "",
            effect(report, c["effect"]),
            "; ".join(parameters(c["parameters"])),
        )
    for i, (what, error) in enumerate(steps(report)):
        yield "%-23s %5.3f %s" % ("" if i else error_name(report) + ":", error, what)
    yield "%29.3f noise of the poses alone" % report["noise_floor"]
    if is_held_out(report):
        yield crossed(report)
    yield from extent(report)
    yield from slight(report)
    yield from left(report)
    yield from apart(report)
    yield from unexplained(report)
