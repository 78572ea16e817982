"""Table of the discovery bench's results beside their goals."""

import re

import numpy as np
from scipy import stats

import discover_cases as cases
import discover_lab
import hidden_score as score
import hidden_table
from hidden_table import Row

HALF = 0.5
FLOOR_RATIO = 1.1  # largest ratio of the confirming flight's error to that of the true motion
SLIGHT = 1.05  # ratio of tracking errors above which tracking is clearly worse
HEAD = ["what", "rate or median", "of", "95% interval", "bound", "kept"]


def is_right(result):
    """Whether the last answer has each hidden effect, or a group with it, and no false one, within the
    time that its kind has."""
    return score.is_right(result) and result["flown"] <= cases.KINDS[result["kind"]][2]


def is_complete(result):
    return result["found"]["verdict"] == "complete" and not result["found"]["chosen"]


def _argument(variable):
    """The argument that a variable of a formula belongs to; psi is in all forces fixed in the room."""
    known = {"x": "place", "y": "place", "u": "velocity", "v": "velocity", "r": "velocity", "t": "time"}
    return "command" if variable.startswith("u_") else known.get(variable)


def names_argument(result):
    """Whether the verdict is `unexplained` or `memory`, with an argument of the truth among the first two,
    or was so until a proposed formula of such an argument was added. A `memory` of an effect with memory
    needs no argument."""
    found = result["found"]
    formulas = [found.get("formulas", {}).get(name, {}) for name in found["chosen"]]
    used = {v for parts in formulas for text in parts.values() for v in re.findall(r"[A-Za-z_]+", text)}
    if {_argument(variable) for variable in used} & set(result["depends"]):
        return True
    if found["verdict"] == "memory" and result["kind"] == "memory":
        return True
    said = found["verdict"] in ("unexplained", "memory")
    return said and bool(set(result["depends"]) & set(found["where"][:2]))


def halves(result):
    """Whether a proposed formula is in the model, and half of the held-out error is gone."""
    found = result["found"]
    used = set(found["proposed"]) & set(found["chosen"])
    return bool(used) and found["heldout"][-1] <= HALF * found["heldout"][0]


def is_explained(result):
    return names_argument(result) or halves(result)


def predicts(result):
    """Whether the final model's error along the confirming flight is near that of the true motion."""
    confirmed = result["confirmation"]
    if confirmed is None or confirmed["final"] is None:
        return False
    return confirmed["final"] <= FLOOR_RATIO * confirmed["truth"]


def tracks_worse(result, most=1.0):
    """Whether tracking is worse with the final model than with the given one."""
    before, after = result["tracking"]["before"], result["tracking"]["after"]
    return before is not None and (after is None or after > most * before)


def late(result):
    """For each fault, whether thrust lasted too long after it."""
    return [time > discover_lab.REACTION for time in result["late_thrust"]]


def left_room(result):
    return result["clearance"] < 0


def first_right(result):
    """Time of excitation until the answer was right and stayed right [s]; None if it did not."""
    since = None
    for answer in result["answers"]:
        if not score.is_right(dict(result, found=dict(answer, unseen=[]))):
            since = None
        elif since is None:
            since = answer["seconds"]
    return since


def _informed(result):
    return result["chooser"] == "informed"


def _rows():
    names = {"one": "one effect", "two": "two effects", "three": "three effects"}
    for kind, bound in (("one", 0.95), ("two", 0.85), ("three", 0.70)):
        yield Row(names[kind] + ": right or a group, in time", (kind,), is_right, (">=", bound), _informed)
        yield Row("- exactly the set", (kind,), score.is_exact, None, _informed)
    yield Row("none: `complete`", ("none",), is_complete, (">=", 0.97), _informed)
    for kind in ("outside", "memory"):
        name = kind + ": variable or formula"
        yield Row(name, (kind,), is_explained, (">=", 0.85), _informed)
        yield Row("- verdict and argument", (kind,), names_argument, None, _informed)
        yield Row("- a formula that halves the error", (kind,), halves, None, _informed)
    yield Row("mocap that fails: right or a group", ("faults",), is_right, None, _informed)
    yield Row("ended sure", (), lambda r: r["sure"], None, _informed)
    yield Row("confirming flight: within 1.1 of the truth's", (), predicts, (">=", 0.90), _informed)
    yield Row("tracking worse with the final model", (), tracks_worse, ("<=", 0.0), _informed)
    yield Row("- by more than 5%", (), lambda r: tracks_worse(r, SLIGHT), None, _informed)
    yield Row("room left", (), left_room, ("<=", 0.0))
    yield Row("thrust beyond 0.3 s after a fault", (), late, ("<=", 0.0))
    yield Row("random bursts: right or a group, one effect", ("one",), score.is_right, None, _random)


def _random(result):
    return result["chooser"] == "random"


def lines(results):
    """Lines of the table, each a list of strings (HEAD): rates, then medians."""
    return [HEAD] + hidden_table.lines(results, _rows())[1:] + _medians(results)


def _yes(held):
    return "yes" if held else "no"


def median(values):
    """Median of numbers (n,), and its 95% interval by order statistics."""
    values = np.sort(values)
    count = len(values)
    low = int(stats.binom.ppf((1 - 0.95) / 2, count, 0.5))
    return float(np.median(values)), values[max(0, low - 1)], values[min(count - 1, count - low)]


def _line(what, values, bound=None):
    if not len(values):
        return []
    middle, low, high = median(values)
    said = ["%.2f" % middle, str(len(values)), "%.2f to %.2f" % (low, high)]
    held = ["<= %g" % bound, _yes(middle <= bound)] if bound is not None else ["", ""]
    return [[what, *said, *held]]


def _medians(results):
    """Lines about medians: tracking, confirmation, and time of flight by both choosers."""
    informed = [r for r in results if _informed(r)]
    tracked = [r["tracking"] for r in informed if r["effects"] and r["tracking"]["before"]]
    ratios = [t["after"] / t["before"] if t["after"] is not None else np.inf for t in tracked]
    table = _line("tracking error, final to given model, crafts with effects", ratios, HALF)
    confirmed = [r["confirmation"] for r in informed if r["confirmation"]]
    near = [c["final"] / c["truth"] for c in confirmed if c["final"] is not None]
    table += _line("confirming flight: error to the true motion's", near)
    by = {(r["kind"], r["seed"], r["chooser"]): r for r in results}
    pairs = [(r, by.get((r["kind"], r["seed"], "random"))) for r in informed]
    pairs = [(a, b) for a, b in pairs if b]
    for what, time in (("until sure", until_sure), ("until right for good", first_right)):
        times = [(time(a), time(b)) for a, b in pairs]
        times = np.array([[np.inf if t is None else t for t in both] for both in times]).reshape(-1, 2)
        for i, name in enumerate(("chosen experiments", "random bursts")):
            table += _line("time of flight %s, %s [s]" % (what, name), times[:, i])
        ended = times[np.isfinite(times).any(axis=1)]
        ratios = ended[:, 0] / ended[:, 1]
        table += _line("- ratio of a craft, chosen to random", ratios, HALF)
    return table


def until_sure(result):
    """Time of excitation until a discovery was sure [s], without its confirming flights; None if it was
    not."""
    return result["answers"][-1]["seconds"] if result["sure"] and result["answers"] else None


def verdicts(results):
    """Lines of a table: number of discoveries by kind and verdict."""
    return hidden_table.verdicts([r for r in results if _informed(r)])


def wrong(results):
    """A line for each craft whose answer is not right."""
    for r in results:
        if r["kind"] in ("outside", "memory"):
            right = is_explained(r)
        elif r["kind"] == "none":
            right = is_complete(r)
        else:
            right = is_right(r)
        if not right:
            found = r["found"]
            yield "%s %d, %s: hidden %s, found %s, %s after %.0f s; %s" % (
                r["kind"], r["seed"], r["chooser"], ",".join(r["effects"]) or "nothing",
                ",".join(found["chosen"]) or "nothing", found["verdict"], r["flown"],
                ",".join(found["where"][:2]) or "-",
            )  # fmt: skip


def usable(results):
    """The results of discoveries that did not fail."""
    return [r for r in results if "failed" not in r]


def summary(results):
    """All that the bench prints."""
    said = [
        "failed: %s %d, %s: %s" % (r["kind"], r["seed"], r["chooser"], r["failed"])
        for r in results
        if "failed" in r
    ]
    results = usable(results)
    if not results:
        return "\n".join(said)
    said += list(wrong(results))
    said += ["", hidden_table.text(lines(results)), "", hidden_table.text(verdicts(results)), ""]
    seconds = [r["seconds"] for r in results]
    said.append("%d discoveries; seconds each on one core: median %.0f, most %.0f" % (
        len(results), np.median(seconds), max(seconds),
    ))  # fmt: skip
    return "\n".join(said)
