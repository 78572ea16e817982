"""A history as the dictionary of history.json (schema ground/history/1)."""

from typing import Any, Dict, Iterator, Sequence

import numpy as np

from ground import _core
from ground.analysis.distributions import normal_limit
from ground.effect_library.parameters import described
from ground.ledger import changes
from ground.ledger.analysed import CHANCE, Analysed, Odd
from ground.ledger.changes import ParameterChange
from ground.support.annotations import Document

SCHEMA = "ground/history/1"
WIDE = 2.0  # half length of an interval, in a parameter's size, from which a run tells nothing of use
SEEN = 1e-3  # least scatter that is reported, in a parameter's size
NORMAL = normal_limit(0.025)


def of(
    folders: Sequence[str],
    crafts_by: str,
    types: Sequence[Analysed],
    runs: Sequence[Sequence[Document]],
    left_out: Sequence[Document],
    verdicts: Sequence[Document],
) -> Document:
    """The report. types: one for each model; runs: what is known of their runs, by type; left_out: path and
    why; verdicts: of saved diagnoses."""
    every = list(zip(types, runs))
    return {
        "schema": SCHEMA,
        "version": _core.version,
        "folders": list(folders),
        "crafts_by": crafts_by,
        "types": [_type(found) for found in types],
        "crafts": [craft for found, known in every for craft in _crafts(found, known)],
        "changes": [change for found, known in every for change in _changes(found, known)],
        "odd": [_odd(found, one) for found in types for one in found.odd],
        "runs": [run for found, known in every for run in _runs(found, known)],
        "left_out": list(left_out),
        "verdicts": list(verdicts),
    }


def _type(found: Analysed) -> Document:
    """The model of a type, and how its parameters scatter: standard deviations of relative size where the
    parameter has one, else in its unit."""
    known = described(found.model.core)
    parameters = {}
    for i, name in enumerate(found.free):
        size = abs(found.value(i, float(np.median(found.levels.mean[:, i]))))
        factor = 1.0 if relative(name) else found.scale[i]
        parameters[name] = {
            "unit": known[name].unit,
            "means": known[name].doc,
            "relative": relative(name),
            "size": size,
            "run_scatter": _scatter(factor, found.levels.run[i]),
            "day_scatter": _scatter(factor, found.levels.day[i]),
            "days_repeat": found.runs.repeated,
        }
    return {
        "name": found.model.name,
        "file": found.model.path,
        "text": found.model.format(),
        "parameters": parameters,
    }


def _scatter(factor: float, variance: float) -> float:
    """A standard deviation; zero if it is too small to matter."""
    return float(factor * np.sqrt(variance)) if variance > SEEN**2 else 0.0


def relative(parameter: str) -> bool:
    """Whether differences of a parameter are in percent: parameters of the body, which are never zero."""
    return "." not in parameter


def _crafts(found: Analysed, runs: Sequence[Document]) -> Iterator[Document]:
    for number, name in enumerate(found.crafts):
        own = np.flatnonzero(found.runs.craft == number)
        deviation = np.sqrt(np.diag(found.levels.covariance[number]))
        levels = {}
        for i, parameter in enumerate(found.free):
            now, reach = found.levels.mean[number, i], NORMAL * deviation[i]
            known = reach < WIDE
            levels[parameter] = found.interval(i, now, now - reach, now + reach) if known else None
        yield {
            "name": name,
            "type": found.model.name,
            "runs": len(own),
            "days": len(set(found.runs.day[own].tolist())),
            "first": runs[own[0]]["recorded"],
            "last": runs[own[-1]]["recorded"],
            "now": levels,
        }


def _changes(found: Analysed, runs: Sequence[Document]) -> Iterator[Document]:
    """All changes, the most certain first."""
    every = [(one.chance, key, one) for key, own in found.changes.items() for one in own]
    for _, (craft, i), one in sorted(every, key=lambda entry: entry[:2]):
        yield {"craft": found.crafts[craft], "type": found.model.name, **_change(found, runs, craft, i, one)}


def _change(found: Analysed, runs: Sequence[Document], craft: int, i: int, one: ParameterChange) -> Document:
    at = found.of(craft, i)
    curve, is_jump = found.curves[at, i], one.kind == changes.JUMP
    first, last = (at[one.at - 1], at[one.at]) if is_jump else (at[0], at[-1])
    start = float(curve[one.at - 1]) if is_jump else float(curve[0])
    before = found.value(i, start)
    after = found.interval(i, start + one.size, start + one.low, start + one.high)
    return {
        "parameter": found.free[i],
        "kind": one.kind,
        "before": before,
        "after": after["value"],
        "after_ci95": after["ci95"],
        "between": [runs[first]["name"], runs[last]["name"]],
        "times": [runs[first]["recorded"], runs[last]["recorded"]],
        "runs": len(at),
        "p_value": min(1.0, one.chance * CHANCE / found.level(i)),
    }


def _odd(found: Analysed, one: Odd) -> Document:
    others = [c for c in range(len(found.crafts)) if c != one.craft]
    values = [found.value(one.parameter, found.levels.mean[c, one.parameter]) for c in others]
    level = found.levels.mean[one.craft, one.parameter]
    reach = NORMAL * np.sqrt(found.levels.covariance[one.craft, one.parameter, one.parameter])
    return {
        "craft": found.crafts[one.craft],
        "type": found.model.name,
        "parameter": found.free[one.parameter],
        **found.interval(one.parameter, level, level - reach, level + reach),
        "others": {found.crafts[c]: value for c, value in zip(others, values)},
        "either": one.alone,
    }


def _runs(found: Analysed, runs: Sequence[Document]) -> Iterator[Document]:
    """Each run with its estimates, each parameter as it is when the others are as usual."""
    for number, run in enumerate(runs):
        values: Dict[str, Any] = {}
        for i, parameter in enumerate(found.free):
            value, information = found.each[number, i], found.known[number, i]
            reach = NORMAL / np.sqrt(max(information, 1e-300))
            if reach < WIDE:
                mean = found.curves[number, i]
                values[parameter] = found.interval(i, value, value - reach, value + reach)
                values[parameter]["mean"] = None if np.isnan(mean) else found.value(i, float(mean))
            else:
                values[parameter] = None
        yield {
            **run,
            "craft": found.crafts[found.runs.craft[number]],
            "type": found.model.name,
            "parameters": values,
        }
