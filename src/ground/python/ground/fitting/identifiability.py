"""Parameters that a fit does not identify, in words."""

from typing import Iterator, List, Sequence

import numpy as np

from ground import _core
from ground.recordings import payloads
from ground.support.annotations import Document

WELL_KNOWN = 0.03  # relative deviation below which a parameter is well known
MAX_COMBINED = 0.5  # largest deviation of a combination to be named, relative to its better part


def with_mass(free: Sequence[str], runs: Sequence[_core.RunData]) -> List[str]:
    """The free parameters and the mass m, where the payloads of runs (_core.RunData) differ: then motion
    identifies m, I_z and k themselves, else only their ratios."""
    joint = payloads.differ(runs) and {"k", "I_z"} <= set(free) and "m" not in free
    return ["m"] * joint + list(free)


def without_mass(free: Sequence[str], runs: Sequence[_core.RunData]) -> List[str]:
    """The free parameters that runs of the same payload identify: not m beside I_z and k."""
    joint = {"k", "I_z"} <= set(free) and not payloads.differ(runs)
    return [name for name in free if not (joint and name == "m")]


def of_payloads(runs: Sequence[_core.RunData], free: Sequence[str]) -> Iterator[str]:
    """Sentences on what the craft carried, and what follows."""
    carried = ["%s: %s" % (run.name, payloads.in_words(run.payload)) for run in runs]
    if not all(run.payload.empty() for run in runs):
        yield "payloads: " + "; ".join(carried)
    if payloads.differ(runs) and {"m", "I_z", "k"} <= set(free):
        yield (
            "the runs differ in mass by known payloads, so m, I_z and k themselves are identifiable, not "
            "only ratios"
        )


def weak_directions(fit: Document) -> List[Document]:
    """Pairs of parameters of which only the ratio or product is identifiable, strongest first.

    Returns dictionaries with `parameters` (two names), `known_as` ("a/b", or "a + b" for some
    weights), its relative standard deviation and those of the two. Linear in the logarithms of
    the parameters, by the covariance that the fit gives.
    """
    rows = [
        (i, p["name"], p["deviation"] / abs(p["value"]))
        for i, p in enumerate(fit["parameters"])
        if p["identified"] and p["value"] != 0 and np.isfinite(p["deviation"])
    ]
    found = []
    for at, (i, first, a) in enumerate(rows):
        for j, second, b in rows[at + 1 :]:
            sign = np.sign(fit["parameters"][i]["value"] * fit["parameters"][j]["value"])
            together = sign * fit["correlation"][i][j]
            known = np.sqrt(max(a * a + b * b - 2 * abs(together) * a * b, 0.0))
            worse, better = max(a, b), min(a, b)
            if better < WELL_KNOWN or known > MAX_COMBINED * better:
                continue
            found.append(
                {
                    "parameters": [first, second],
                    "known_as": ("%s/%s" if together > 0 else "%s + %s") % (first, second),
                    "deviation": float(known),
                    "deviations": [float(a), float(b)],
                    "strength": float(worse / max(known, 1e-9)),
                }
            )
    return sorted(found, key=lambda w: float(-w["strength"]))


def sentences(fit: Document) -> Iterator[str]:
    """Sentences for the user about parameters that are not identifiable."""
    for p in fit["parameters"]:
        if p["identified"] and p["at_bound"]:
            yield "%s is at its bound; the data prefer a value beyond it" % p["name"]
    for weak in weak_directions(fit):
        first, second = weak["parameters"]
        yield (
            "%s and %s are only known as %s: this to ±%.2g%%, %s to ±%.2g%% and %s to ±%.2g%% (one "
            "standard deviation); fix one of them, or record inputs that distinguish them"
            % (
                first,
                second,
                weak["known_as"],
                100 * weak["deviation"],
                first,
                100 * weak["deviations"][0],
                second,
                100 * weak["deviations"][1],
            )
        )
