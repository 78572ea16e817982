"""What a history says: what changed, which craft is odd, how much scatters, and what to do next."""

import shlex
from datetime import date
from typing import Iterator, List, Optional, Sequence

from ground.ledger.changes import FEWEST
from ground.reports.words import listed
from ground.support.annotations import Document
from ground.support.headline import Line
from ground.support.quantities import quantity, with_interval

SHOWN = 3  # changes in the first lines
REFITTED = 4  # newest runs that a command names
BY = {"model": "the recorded model's file", "folder": "folder", "pattern": "the pattern"}
CAUSES = {  # what usually changes a parameter
    "k": "new battery, new propeller?",
    "I_z": "something mounted, moved or taken off?",
    "X_u": "the skirt, the floor, the hull?",
    "Y_v": "the skirt, the floor, the hull?",
    "N_r": "the skirt, the floor, the hull?",
    "thrust_asymmetry": "a propeller or motor of one side?",
    "motor_lag": "new motor or speed controller, a delay of the link?",
    "input_delay": "the link, the computer, the firmware?",
    "com_offset": "the battery's place?",
    "marker_offset": "markers moved?",
    "thrust_curve": "new motor, propeller or speed controller?",
}


def lines(report: Document, page: str = "") -> List[Line]:
    """All first lines; page: its file; empty: it is not written, and commands are for Python."""
    found = [("Changed" if not i else "", text) for i, text in enumerate(_changed(report))]
    found += [("Odd craft" if not i else "", text) for i, text in enumerate(_odd(report))]
    found += [("Scatter", _scatter(report)), ("Runs", _runs(report))]
    found += [("Verdicts", text) for text in _verdicts(report, bool(page))]
    found.append(("Next", _next(report, bool(page))))
    return found + [("Details", page)] * bool(page)


def _changed(report: Document) -> Iterator[str]:
    found, least = report["changes"], 2 * FEWEST
    if all(craft["runs"] < least for craft in report["crafts"]):
        yield "cannot be said - that takes %d runs of a craft." % least
    elif not found:
        yield "nothing - the runs of each craft agree within their scatter."
    for one in found[:SHOWN]:
        yield change(report, one) + cause(one["parameter"])
    if len(found) > SHOWN:
        yield "and %d more, on the page." % (len(found) - SHOWN)


def cause(parameter: str) -> str:
    """What may have changed a parameter, as the end of a sentence."""
    known = CAUSES.get(parameter, CAUSES.get(parameter.split(".")[0], ""))
    return ": " + known if known else "."


def change(report: Document, one: Document) -> str:
    """A change as a sentence without its end: "k of A fell by 6% (5 to 7%) between ..."."""
    is_jump, rises = one["kind"] == "jump", one["after"] > one["before"]
    by = "by " if is_relative(report, one) else ""
    name = "%s of %s" % (one["parameter"], one["craft"])
    days = tuple(day(time) for time in one["times"])
    told = _sizes(report, one)
    if is_jump:
        runs = tuple(name.rsplit("/", 1)[-1] for name in one["between"])
        verb = "rose" if rises else "fell"
        return "%s %s %s%s between %s and %s (%s and %s)" % (name, verb, by, told, *days, *runs)
    verb = "rises" if rises else "falls"
    each = ""
    if by:
        each = "%s a run, " % _percent(abs(_share(one, one["after"])) / max(1, one["runs"] - 1))
    return "%s %s %s%s%s over %d runs from %s to %s" % (name, verb, by, each, told, one["runs"], *days)


def _sizes(report: Document, one: Document) -> str:
    """The size of a change with its interval: a share, or from where to where."""
    known = [end for end in one["after_ci95"] if end is not None]
    if is_relative(report, one):
        ends = sorted(abs(_share(one, end)) for end in known)
        return "%s (%s)" % (_percent(abs(_share(one, one["after"]))), " to ".join(map(_percent, ends)))
    unit = _type(report, one)["parameters"][one["parameter"]]["unit"]
    values = [quantity(value, unit, 2) for value in (one["before"], one["after"], *sorted(known))]
    return "from %s to %s (%s)" % (values[0], values[1], " to ".join(values[2:]))


def sorted_ends(ends: Sequence[Optional[float]]) -> Sequence[Optional[float]]:
    """Low and high of an interval; None is an end without a number."""
    known = [end for end in ends if end is not None]
    return sorted(known) if len(known) == len(ends) else ends


def is_relative(report: Document, one: Document) -> bool:
    """Whether a change or a difference is in percent."""
    relative: bool = _type(report, one)["parameters"][one["parameter"]]["relative"]
    return relative and one.get("before", 1.0) != 0


def _type(report: Document, one: Document) -> Document:
    return next(kind for kind in report["types"] if kind["name"] == one["type"])


def _share(one: Document, end: float) -> float:
    return float(end) / float(one["before"]) - 1


def _percent(share: float) -> str:
    """A share in percent, with two digits."""
    return ("%.2g%%" if share < 0.0995 else "%.0f%%") % (100 * share)


def day(time: str) -> str:
    """ "3 May 2025" of an ISO time."""
    found = date(*map(int, time[:10].split("-")))
    return "%d %s" % (found.day, found.strftime("%b %Y"))


def _odd(report: Document) -> Iterator[str]:
    for one in report["odd"]:
        unit = _type(report, one)["parameters"][one["parameter"]]["unit"]
        others = sorted(one["others"].values())
        span = " to ".join(dict.fromkeys(quantity(end, unit, 2) for end in (others[0], others[-1])))
        told = "%s is %s" % (one["parameter"], quantity(one["value"], unit))
        low, high = sorted_ends(one["ci95"])
        if low is not None and high is not None:
            told = "%s is %s" % (one["parameter"], with_interval(one["value"], low, high, unit))
        if one["either"]:
            yield "%s or %s - %s of %s, and %s of %s." % (
                one["craft"], next(iter(one["others"])), told, one["craft"], span, next(iter(one["others"])),
            )  # fmt: skip
        else:
            yield "%s - its %s; %s of the other %d." % (one["craft"], told, span, len(others))
    if not report["odd"] and len(report["crafts"]) > len(report["types"]):
        yield "none"


def _scatter(report: Document) -> str:
    """How much k, or what stands for it, differs from run to run and from day to day."""
    found = []
    for kind in report["types"]:
        name = "k" if "k" in kind["parameters"] else next(iter(kind["parameters"]))
        of = " of %s" % kind["name"] if len(report["types"]) > 1 else ""
        found.append("%s%s %s" % (name, of, scatter(kind["parameters"][name])))
    return "; ".join(found) + "."


def scatter(parameter: Document) -> str:
    """Standard deviations between runs and days."""

    def told(size: float) -> str:
        if not size:
            return "none seen"
        if parameter["relative"]:
            return _percent(size)
        return quantity(size, parameter["unit"], 2)

    text = "%s from run to run" % told(parameter["run_scatter"])
    if parameter["days_repeat"]:
        text += ", %s from day to day" % told(parameter["day_scatter"])
    return text


def _runs(report: Document) -> str:
    runs, out = report["runs"], len(report["left_out"])
    crafts = [craft["name"] for craft in report["crafts"]]
    named = "%d crafts, by %s" % (len(crafts), BY[report["crafts_by"]]) if len(crafts) > 1 else crafts[0]
    times = sorted(run["recorded"] for run in runs)
    text = "%d of %s, %s to %s" % (len(runs), named, day(times[0]), day(times[-1]))
    text += "; %d left out (the details say why)" % out if out else ""
    guessed = sum(run["time_from"] == "file" for run in runs)
    if guessed:
        text += "; the time of %d is the file's last change: neither stamps nor names have a date" % guessed
    return text + "."


def _verdicts(report: Document, in_shell: bool) -> Iterator[str]:
    found = report["verdicts"]
    other = [one for one in found if not one["current"]]
    if not other:
        return
    changed = [one for one in other if one["now"] and one["now"]["changed"]]
    if any(one["now"] for one in other):
        names = listed([one["folder"] for one in changed]) if changed else "none"
        yield "%d of %d repeated diagnoses change with version %s: %s." % (
            len(changed), len(other), report["version"], names,
        )  # fmt: skip
        return
    yield "%d of %d saved diagnoses are of another version than %s; %s repeats them." % (
        len(other), len(found), report["version"], "--verdicts" if in_shell else "verdicts=True",
    )  # fmt: skip


def _next(report: Document, in_shell: bool) -> str:
    if report["changes"]:
        one = report["changes"][0]
        since = one["times"][1] if one["kind"] == "jump" else ""
        return "fit %s anew%s:\n%s" % (
            one["craft"],
            " to the runs since then" if since else " to its newest runs",
            _command(report, "fit", one, since, in_shell, "%s.yaml" % one["craft"]),
        )
    if report["odd"]:
        one = report["odd"][0]
        which = listed([one["craft"], *one["others"]]) if one["either"] else one["craft"]
        return "look at %s, and give %s a model of its own:\n%s" % (
            which,
            "each" if one["either"] else "it",
            _command(report, "diagnose", one, "", in_shell, "diagnosis"),
        )
    return "fly on; repeated, it fits new runs only."


def _command(report: Document, verb: str, one: Document, since: str, in_shell: bool, output: str) -> str:
    """A command on the newest runs of a craft."""
    runs = [r for r in report["runs"] if r["craft"] == one["craft"] and r["recorded"] >= since]
    paths, model = [run["path"] for run in runs[-REFITTED:]], _type(report, one)["file"] or "MODEL.yaml"
    if not in_shell:
        return "ground.%s(%r, %r)" % (verb, model, paths)
    words = [verb, *paths, "--model", model, "-o", output]
    return "rosrun ground identify " + " ".join(map(shlex.quote, words))


def crafts(report: Document) -> Iterator[str]:
    """A table of the crafts as they are now."""
    for kind in report["types"]:
        own = [craft for craft in report["crafts"] if craft["type"] == kind["name"]]
        width = max(5, *(len(craft["name"]) for craft in own))
        names = list(kind["parameters"])
        units = [kind["parameters"][name]["unit"].replace("-", "") for name in names]
        heads = ["%s [%s]" % (n, u) if u and u != "1" else n for n, u in zip(names, units)]
        columns = [max(10, len(head)) for head in heads]
        yield "%-*s %5s %5s  " % (width, "craft", "runs", "days") + "  ".join(
            "%*s" % pair for pair in zip(columns, heads)
        )
        for craft in own:
            now = [craft["now"][name] for name in names]
            cells = ["%.4g" % value["value"] if value else "-" for value in now]
            yield "%-*s %5d %5d  " % (width, craft["name"], craft["runs"], craft["days"]) + "  ".join(
                "%*s" % pair for pair in zip(columns, cells)
            )


def evidence(report: Document) -> Iterator[str]:
    """The lines of --details: all changes, a line for each run, what was left out, and the verdicts."""
    for one in report["changes"]:
        yield "%s (p = %.1g)." % (change(report, one), one["p_value"])
    for kind in report["types"]:
        for name, parameter in kind["parameters"].items():
            yield "Scatter of %s (%s): %s." % (name, parameter["means"], scatter(parameter))
    yield ""
    width = max(len(run["name"]) for run in report["runs"])
    for run in report["runs"]:
        values = ["%s %s" % (n, told(v)) for n, v in run["parameters"].items() if v is not None]
        yield "%s  %-*s  %s: %s" % (run["recorded"], width, run["name"], run["craft"], ", ".join(values))
    for one in report["left_out"]:
        yield "%s was left out: %s" % (one["path"], one["why"])
    for one in report["verdicts"]:
        yield verdict(one)


def told(value: Optional[Document]) -> str:
    """A value with its interval; an end without a number stays empty."""
    if value is None:
        return "-"
    low, high = ("" if end is None else "%.3g" % end for end in sorted_ends(value["ci95"]))
    return "%.3g (%s to %s)" % (value["value"], low, high)


def verdict(one: Document) -> str:
    """A saved diagnosis, and what this version says."""
    made = "version %s" % one["version"] if one["version"] else "a version that did not say which"
    text = "%s: %s (%s), by %s" % (one["folder"], one["verdict"], listed(one["effects"]) or "no effect", made)
    now = one["now"]
    if now is None:
        return text
    if now["why"]:
        return "%s; it cannot be repeated: %s" % (text, now["why"])
    return "%s; now: %s (%s)" % (text, now["verdict"], listed(now["effects"]) or "no effect")
