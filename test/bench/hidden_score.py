"""Scores for the answers of the hidden-effect bench.

A result is a line of hidden.py: a case with the answer of hidden_engine.diagnose under `found`. A score
is None where it does not apply.
"""

import math

from ground import _core

MEMORY_LIKE = ("history", "unequal_delays", "jittered_link")  # kinds in which the past matters
UNDECIDED = "undecided"  # verdict that these runs cannot decide
QUIET = ("complete", "varies", UNDECIDED)  # verdicts that do not say that something is missing
LEARNABLE = 0.1  # share of the error from which something learnable is left
SEEN = 0.9  # largest ratio of the errors with and without a missing effect at which it shows


def chosen(result):
    return set(result["found"]["chosen"])


def equals(result, name):
    """A chosen effect and those that the tool declares equal to it."""
    return {name} | set(result["found"]["groups"].get(name, []))


def false_effects(result):
    """Chosen effects that are neither hidden or allowed nor declared equal to such a one."""
    there = set(result["hidden"]) | set(result["allowed"])
    return {name for name in chosen(result) if not equals(result, name) & there}


def has_false_effect(result):
    return bool(false_effects(result))


def has_any_effect(result):
    return bool(chosen(result))


def is_exact(result):
    """Whether the chosen effects are the hidden ones."""
    return chosen(result) - set(result["allowed"]) == set(result["hidden"])


def is_found(result):
    """Whether each hidden effect was chosen, or declared equal to a chosen one, or declared not
    identifiable from these runs."""
    found = set(result["found"].get("unseen", ())).union(*(equals(result, name) for name in chosen(result)))
    return set(result["hidden"]) <= found


def is_right(result):
    """Whether each hidden effect and no false one was found."""
    return is_found(result) and not false_effects(result)


def not_unexplained(result):
    return result["found"]["verdict"] != "unexplained"


def says_varies(result):
    """Whether the diagnosis reports that something differs from run to run."""
    return bool(result["found"]["varies"])


def says_memory(result):
    """Whether the diagnosis reports that history matters."""
    return bool(result["found"]["memory"]) or result["found"]["verdict"] == "memory"


def false_memory(result):
    """Whether the diagnosis reports falsely that history matters; None if it matters."""
    if result["kind"] in MEMORY_LIKE or "past" in arguments(result):
        return None
    return says_memory(result)


def says_missing(result):
    """Whether the diagnosis says that something is missing, other than what counts as right."""
    if result["found"]["verdict"] == "missing":
        return bool(chosen(result) - set(result["allowed"]))
    return result["found"]["verdict"] not in QUIET


def is_undecided(result):
    """Whether the diagnosis says that these runs cannot decide."""
    return result["found"]["verdict"] == UNDECIDED


# --- Effects without a name. The diagnosis reports a `ceiling`: shares [value, low, high] of the held-out
# error that are `named`, `learnable` and left to `chance`; `arguments` {name: share}; `kept`, the held-out
# error with what it can offer (a formula).


def is_said(result):
    """Whether the verdict is not `complete`."""
    return result["found"]["verdict"] != "complete"


def arguments(result):
    """What a nameless effect depends on."""
    return result["effects"].get("nameless", {}).get("arguments", [])


def ceiling(result):
    return result["found"].get("ceiling") or {}


def has_right_argument(result):
    """Whether the argument with the largest share is one of the effect's; None without arguments."""
    shares = ceiling(result).get("arguments")
    if shares is None:
        return None
    return bool(shares) and max(shares, key=shares.get) in arguments(result)


def halves_excess(result):
    """Whether the model with what the diagnosis offers has at most half of the error that the missing effect
    adds to runs held out; None if it adds hardly any."""
    nominal, least = result["errors_true"]
    if least > SEEN * nominal:
        return None
    kept = ceiling(result).get("kept")
    kept = result["found"]["errors"]["steps"][-1] if kept is None else kept
    return kept - least <= (nominal - least) / 2


def learnable_holds(result):
    """Whether what is named and learnable together, with the uncertainty of both, holds the true share; None
    without shares."""
    if "learnable" not in ceiling(result):
        return None
    low, high = explained(result)
    return low <= result.get("learnable_true", 0.0) <= high


def explained(result):
    """95% interval of what is named and learnable together."""
    nothing = [0.0, 0.0, 0.0]
    (named, a, b), (left, low, high) = (ceiling(result).get(k, nothing) for k in ("named", "learnable"))
    below, above = math.hypot(named - a, left - low), math.hypot(b - named, high - left)
    return named + left - below, named + left + above


def excludes_truth(result):
    """Whether the verdict is `complete` with a learnable share whose upper bound is below the true one."""
    left = ceiling(result).get("learnable")
    if left is None:
        return None
    return not is_said(result) and explained(result)[1] < result["learnable_true"]


def is_falsely_complete(result):
    """Whether the verdict is `complete` although something learnable is missing; None if nothing is."""
    return None if result["learnable_true"] < LEARNABLE else not is_said(result)


def made_worse(result):
    """Whether the held-out error is above that of an earlier step, including the nominal model; None if
    nothing was added. Two effects may lower it only together."""
    errors = result["found"]["errors"]["steps"]
    if not chosen(result):
        return None
    return errors[-1] > min(errors)


def intervals(result, effects=True):
    """Whether the interval of each identified parameter of hidden effects (or of the body) holds the
    true value. A chosen effect that is not hidden has no true value."""
    asked = [p for p in result["found"]["parameters"] if p["identified"] and p.get("true") is not None]
    if effects:
        asked = [p for p in asked if p["name"].split(".")[0] in result["hidden"]]
    else:
        asked = [p for p in asked if "." not in p["name"]]
    return [bool(p["ci95"][0] <= p["true"] <= p["ci95"][1]) for p in asked]


def p_values(result):
    """P-values of effects of either sign. (For a one-sided effect half of the p-values are 1.)"""
    free = free_effects()
    return [p for name, p in result["found"]["p_values"].items() if name in free]


def free_effects():
    """Effects without a parameter whose neutral value is a bound."""
    return {
        name
        for name, effect in _core.effects().items()
        if not any(p["neutral"] in (p["lower"], p["upper"]) for p in effect["parameters"])
    }
