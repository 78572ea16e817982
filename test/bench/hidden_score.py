"""How right an answer of the hidden-effect bench is.

A result is a line of hidden.py: a case and, as `found`, what hidden_engine.diagnose says of it. A
score is None where the question does not arise.
"""

from ground import _core

MEMORY_LIKE = ("history", "unequal_delays", "jittered_link")  # kinds in which the past does matter
NEAR = 1.05  # of the true model's error: as good as the truth


def chosen(result):
    return set(result["found"]["chosen"])


def equals(result, name):
    """A chosen effect and those that the tool declares its equals."""
    return {name} | set(result["found"]["groups"].get(name, []))


def false_effects(result):
    """What was chosen, is not there and was not declared equal to anything that is."""
    there = set(result["hidden"])
    false = {name for name in chosen(result) if not equals(result, name) & there}
    return false - set(result["allowed"])


def has_false_effect(result):
    return bool(false_effects(result))


def has_any_effect(result):
    return bool(chosen(result))


def is_exact(result):
    """Whether the chosen effects are the hidden ones."""
    return chosen(result) - set(result["allowed"]) == set(result["hidden"])


def is_found(result):
    """Whether each hidden effect was chosen, declared equal to a chosen one, or to other parameters
    of the model (the runs cannot show it)."""
    told = set(result["found"].get("unseen", ())).union(
        *(equals(result, name) for name in chosen(result))
    )
    return set(result["hidden"]) <= told


def is_right(result):
    """Whether each hidden effect was found, and nothing else."""
    return is_found(result) and not false_effects(result)


def is_visible(result, least):
    """Whether each hidden effect is worth that 2 ln L at least; None where it is not known."""
    worth = result.get("visibility")
    return min(worth.values()) >= least if worth else None


def not_unexplained(result):
    return result["found"]["verdict"] != "unexplained"


def says_varies(result):
    """Whether it says that something differs from run to run."""
    return bool(result["found"]["varies"])


def says_memory(result):
    """Whether it says that history matters."""
    return bool(result["found"]["memory"]) or result["found"]["verdict"] == "memory"


def false_memory(result):
    return None if result["kind"] in MEMORY_LIKE else says_memory(result)


def made_worse(result):
    """Whether the error on the runs held out is above that of a part of the answer, or of none of
    it; None where nothing was added. Two effects may lower it only together."""
    errors = result["found"]["errors"]["steps"]
    if not chosen(result):
        return None
    return errors[-1] > min(errors)


def intervals(result, effects=True):
    """Whether the interval of each identified parameter, of hidden effects or of the body, holds.
    What is chosen and not hidden stands for something else, and has no true value."""
    asked = [p for p in result["found"]["parameters"] if p["identified"] and p.get("true") is not None]
    if effects:
        asked = [p for p in asked if p["name"].split(".")[0] in result["hidden"]]
    else:
        asked = [p for p in asked if "." not in p["name"]]
    return [bool(p["ci95"][0] <= p["true"] <= p["ci95"][1]) for p in asked]


def p_values(result):
    """P-values of effects that may have either sign: those of others are 1 half of the time."""
    free = free_effects()
    return [p for name, p in result["found"]["p_values"].items() if name in free]


def free_effects():
    """Effects none of whose parameters is neutral at a bound."""
    return {
        name
        for name, effect in _core.effects().items()
        if not any(p["neutral"] in (p["lower"], p["upper"]) for p in effect["parameters"])
    }


def as_good_as_the_truth(result):
    """Whether the error on what was held out is within NEAR of the refitted truth's."""
    return result["found"]["errors"]["steps"][-1] <= NEAR * result["true_error"]


def is_first(result):
    """Whether the hidden effect was ranked first."""
    return result["found"]["first"][:1] == result["hidden"]


def tells(result, when):
    """Of runs that cannot tell two rivals: whether the answer is right and not a group."""
    told = result.get(when)
    return bool(told) and told["chosen"] == result["hidden"] and len(told["group"]) == 1
