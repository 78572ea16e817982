"""What a history says: what changed, which craft is odd, how much scatters, and what to do next."""

import math
import shlex
from datetime import date
from typing import Iterator, List, Optional, Sequence

from ground.ledger.changes import JUMP, MIN_RUNS
from ground.ledger.contents import CraftFinding, FollowedParameter, FoundChange, HistoryContents, LevelValue
from ground.ledger.verdicts import SavedVerdict
from ground.reports.words import listed
from ground.support.headline import Line
from ground.support.quantities import quantity, same_decimals, with_interval

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
    "com_offset": "the battery's position?",
    "marker_offset": "markers moved?",
    "thrust_curve": "new motor, propeller or speed controller?",
}


def lines(found: HistoryContents, page: str = "") -> List[Line]:
    """All first lines; page: its file; empty: it is not written, and commands are for Python."""
    told = [("Changed" if not i else "", text) for i, text in enumerate(_changed(found))]
    told += [("Odd craft" if not i else "", text) for i, text in enumerate(_odd(found))]
    told += [("Scatter", _scatter(found)), ("Runs", _runs(found))]
    told += [("Verdicts", text) for text in _verdicts(found, bool(page))]
    told.append(("Next", _next(found, bool(page))))
    return told + [("Details", page)] * bool(page)


def _changed(found: HistoryContents) -> Iterator[str]:
    least = 2 * MIN_RUNS
    if all(craft.runs < least for craft in found.crafts):
        yield "cannot be decided - a craft needs at least %d runs." % least
    elif not found.changes:
        yield "nothing - the runs of each craft agree within their scatter."
    for one in found.changes[:SHOWN]:
        yield change(found, one) + cause(one.parameter)
    if len(found.changes) > SHOWN:
        yield "and %d more, on the page." % (len(found.changes) - SHOWN)


def cause(parameter: str) -> str:
    """What may have changed a parameter, as the end of a sentence."""
    known = CAUSES.get(parameter, CAUSES.get(parameter.split(".")[0], ""))
    return ": " + known if known else "."


def change(found: HistoryContents, one: FoundChange) -> str:
    """A change as a sentence without its end: "k of A fell by 6% (5 to 7%) between ..."."""
    rises, is_share = one.after > one.before, _is_share(found, one)
    first, last = map(day, one.times)
    name, by = "%s of %s" % (one.parameter, one.craft), "by " if is_share else ""
    size = _size(found, one)
    if one.kind == JUMP:
        before, after = (run.rsplit("/", 1)[-1] for run in one.between)
        told = "%s %s %s%s between %s and %s (%s and %s)"
        return told % (name, "rose" if rises else "fell", by, size, first, last, before, after)
    verb = "rises" if rises else "falls"
    each = "%s a run, " % _percent(abs(_share(one, one.after)) / max(1, one.runs - 1)) if is_share else ""
    return "%s %s %s%s%s over %d runs from %s to %s" % (
        name, verb, by, each, size, one.runs, first, last,
    )  # fmt: skip


def _size(found: HistoryContents, one: FoundChange) -> str:
    """The size of a change with its interval: a share, or from where to where."""
    known = [end for end in one.after_ci95 if end is not None]
    if _is_share(found, one):
        ends = sorted(abs(_share(one, end)) for end in known)
        return "%s (%s)" % (_percent(abs(_share(one, one.after))), " to ".join(map(_percent, ends)))
    unit = _parameter(found, one).unit
    values = [quantity(value, unit, 2) for value in (one.before, one.after, *sorted(known))]
    return "from %s to %s (%s)" % (values[0], values[1], " to ".join(values[2:]))


def sorted_ends(ends: Sequence[Optional[float]]) -> Sequence[Optional[float]]:
    """Low and high of an interval; None is an end without a number."""
    known = [end for end in ends if end is not None]
    return sorted(known) if len(known) == len(ends) else ends


def _parameter(found: HistoryContents, one: CraftFinding) -> FollowedParameter:
    return found.type_of(one.type).parameters[one.parameter]


def _is_share(found: HistoryContents, one: FoundChange) -> bool:
    """Whether a change is in percent."""
    return _parameter(found, one).relative and one.before != 0


def _share(one: FoundChange, end: float) -> float:
    return end / one.before - 1


def _percent(share: float) -> str:
    """A share in percent, with two digits."""
    return ("%.2g%%" if share < 0.0995 else "%.0f%%") % (100 * share)


def day(time: str) -> str:
    """ "3 May 2025" of an ISO time."""
    found = date(*map(int, time[:10].split("-")))
    return "%d %s" % (found.day, found.strftime("%b %Y"))


def _odd(found: HistoryContents) -> Iterator[str]:
    for one in found.odd:
        unit, others = _parameter(found, one).unit, sorted(one.others.values())
        span = " to ".join(dict.fromkeys(quantity(end, unit, 2) for end in (others[0], others[-1])))
        told = "%s is %s" % (one.parameter, quantity(one.value, unit))
        low, high = sorted_ends(one.ci95)
        if low is not None and high is not None:
            told = "%s is %s" % (one.parameter, with_interval(one.value, low, high, unit))
        if one.either:
            other = next(iter(one.others))
            yield "%s or %s - %s of %s, and %s of %s." % (one.craft, other, told, one.craft, span, other)
        else:
            yield "%s - its %s; %s for the other %d." % (one.craft, told, span, len(others))
    if not found.odd and len(found.crafts) > len(found.types):
        yield "none"


def _scatter(found: HistoryContents) -> str:
    """How much k, or what stands for it, differs from run to run and from day to day."""
    told = []
    for kind in found.types:
        name = "k" if "k" in kind.parameters else next(iter(kind.parameters))
        of = " of %s" % kind.name if len(found.types) > 1 else ""
        told.append("%s%s %s" % (name, of, scatter(kind.parameters[name])))
    return "; ".join(told) + "."


def scatter(parameter: FollowedParameter) -> str:
    """Standard deviations between runs and days."""

    def told(size: float) -> str:
        if not size:
            return "none seen"
        return _percent(size) if parameter.relative else quantity(size, parameter.unit, 2)

    text = "%s from run to run" % told(parameter.run_scatter)
    if parameter.days_repeat:
        text += ", %s from day to day" % told(parameter.day_scatter)
    return text


def _runs(found: HistoryContents) -> str:
    named = found.crafts[0].name
    if len(found.crafts) > 1:
        named = "%d craft, by %s" % (len(found.crafts), BY[found.crafts_by])
    times = sorted(run.recorded for run in found.runs)
    text = "%d of %s, %s to %s" % (len(found.runs), named, day(times[0]), day(times[-1]))
    if found.left_out:
        text += "; %d left out (the details say why)" % len(found.left_out)
    guessed = sum(run.time_from == "file" for run in found.runs)
    if guessed:
        text += "; %d are dated by the file's last change: neither stamps nor names contain a date" % guessed
    return text + "."


def _verdicts(found: HistoryContents, in_shell: bool) -> Iterator[str]:
    other = [one for one in found.verdicts if not one.current]
    repeated = [one.now for one in other if one.now]
    if repeated:
        changed = [one.folder for one in other if one.now and one.now.changed]
        yield "%d of %d repeated diagnoses change with version %s: %s." % (
            len(changed), len(other), found.version, listed(changed) if changed else "none",
        )  # fmt: skip
    elif other:
        yield "%d of %d saved diagnoses are from a version other than %s; %s repeats them." % (
            len(other), len(found.verdicts), found.version, "--verdicts" if in_shell else "verdicts=True",
        )  # fmt: skip


def _next(found: HistoryContents, in_shell: bool) -> str:
    if found.changes:
        one = found.changes[0]
        since = one.times[1] if one.kind == JUMP else ""
        return "fit %s again%s:\n%s" % (
            one.craft,
            " to its newest runs" + " since then" * bool(since),
            _command(found, "fit", one, since, in_shell, "%s.yaml" % one.craft),
        )
    if found.odd:
        odd = found.odd[0]
        return "look at %s, and give %s a model of its own:\n%s" % (
            listed([odd.craft, *odd.others]) if odd.either else odd.craft,
            "each" if odd.either else "it",
            _command(found, "diagnose", odd, "", in_shell, "diagnosis"),
        )
    return "keep flying; the next history fits only new runs."


def _command(
    found: HistoryContents,
    verb: str,
    one: CraftFinding,
    since: str,
    in_shell: bool,
    output: str,
) -> str:
    """A command on the newest runs of a craft."""
    runs = [run.path for run in found.runs if run.craft == one.craft and run.recorded >= since]
    paths, model = runs[-REFITTED:], found.type_of(one.type).file or "MODEL.yaml"
    if not in_shell:
        return "ground.%s(%r, %r)" % (verb, model, paths)
    words = [verb, *paths, "--model", model, "-o", output]
    return "rosrun ground identify " + " ".join(map(shlex.quote, words))


def crafts(found: HistoryContents) -> Iterator[str]:
    """A table of the craft as they are now."""
    for kind in found.types:
        own = found.crafts_of(kind)
        width = max(5, *(len(craft.name) for craft in own))
        units = [parameter.unit.replace("-", "") for parameter in kind.parameters.values()]
        heads = ["%s [%s]" % (n, u) if u and u != "1" else n for n, u in zip(kind.parameters, units)]
        columns = [max(10, len(head)) for head in heads]
        yield "%-*s %5s %5s  " % (width, "craft", "runs", "days") + "  ".join(
            "%*s" % pair for pair in zip(columns, heads)
        )
        for craft in own:
            now = [craft.now[name] for name in kind.parameters]
            cells = ["%.4g" % one.value if one else "-" for one in now]
            yield "%-*s %5d %5d  " % (width, craft.name, craft.runs, craft.days) + "  ".join(
                "%*s" % pair for pair in zip(columns, cells)
            )


def evidence(found: HistoryContents) -> Iterator[str]:
    """The lines of --details: all changes, a line for each run, what was left out, and the verdicts."""
    for one in found.changes:
        yield "%s (p = %.1g)." % (change(found, one), one.p_value)
    for kind in found.types:
        for name, parameter in kind.parameters.items():
            yield "Scatter of %s (%s): %s." % (name, parameter.means, scatter(parameter))
    yield ""
    width = max(len(run.name) for run in found.runs)
    for run in found.runs:
        values = ["%s %s" % (n, told(v)) for n, v in run.parameters.items() if v is not None]
        yield "%s  %-*s  %s: %s" % (run.recorded, width, run.name, run.craft, ", ".join(values))
    for out in found.left_out:
        yield "%s was left out: %s" % (out.path, out.why)
    yield from map(verdict, found.verdicts)


def told(value: Optional[LevelValue]) -> str:
    """A value with its interval; an end without a number stays empty."""
    if value is None:
        return "-"
    ends = [math.nan if end is None else end for end in sorted_ends(value.ci95)]
    return ("%s (%s to %s)" % tuple(same_decimals(value.value, *ends))).replace("nan", "")


def verdict(one: SavedVerdict) -> str:
    """A saved diagnosis, and what this version says."""
    made = "version %s" % one.version if one.version else "an unknown version"
    text = "%s: %s (%s), by %s" % (one.folder, one.verdict, listed(one.effects) or "no effect", made)
    now = one.now
    if now is None:
        return text
    if now.why:
        return "%s; it cannot be repeated: %s" % (text, now.why)
    return "%s; now: %s (%s)" % (text, now.verdict, listed(now.effects) or "no effect")
