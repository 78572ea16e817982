"""Tables of the hidden-effect bench's results beside their goals."""

from dataclasses import dataclass
from typing import Callable, Optional, Tuple

from scipy import stats

import hidden_craft
import hidden_score as score
import shares

NAMELESS = ("nameless", "local")
ALL_NULLS = ("null", "disturbed_null", "noise_null", "odd_noise", "trim")
NULLS = ("disturbed_null", "noise_null", "odd_noise", "wrong_givens")
SINGLES = ("disturbed_single", "weak_single")
UNIFORM = 0.01  # p-value of the Kolmogorov-Smirnov test below which p-values are not uniform


@dataclass(frozen=True)
class Row:
    """One question about the results of some kinds, and a bound on the share of yes."""

    what: str
    kinds: Tuple[str, ...]  # () for all
    ask: Callable  # result -> yes, no, None where it does not apply, or a list of these
    bound: Optional[Tuple[str, float]] = None  # "<=", ">=" or "in" (from the share to 98%), and the share
    only: Callable = lambda result: True  # whether the row uses a result

    def answers(self, results):
        """Answers for all results of the row."""
        given = []
        for result in results:
            if (self.kinds and result["kind"] not in self.kinds) or not self.only(result):
                continue
            answer = self.ask(result)
            given += answer if isinstance(answer, list) else [answer]
        return [bool(one) for one in given if one is not None]


def _at_level(level):
    return lambda result: abs(result["level"] - level) < 1e-9


def _rows():
    yield Row("disturbed nulls: an effect chosen", NULLS[:1], score.has_any_effect, ("<=", 0.01))
    for kind in NULLS[1:4]:
        yield Row(kind + ": a false effect", (kind,), score.has_false_effect, ("<=", 0.02))
        yield Row(kind + ": not `unexplained`", (kind,), score.not_unexplained, (">=", 0.95))
    for level in (0.01, 0.02, 0.05):
        at, name = _at_level(level), "one effect, disturbance %g%%: " % (100 * level)
        yield Row(name + "found", SINGLES[:1], score.is_found, (">=", 0.97), at)
        yield Row(name + "right set or group", SINGLES[:1], score.is_right, (">=", 0.97), at)
        yield Row(name + "exactly the set", SINGLES[:1], score.is_exact, None, at)
    yield Row("weak effect (1.1 times): found", SINGLES[1:], score.is_found)
    yield Row("weak effect (1.1 times): a false one", SINGLES[1:], score.has_false_effect)
    trims = ("trim", "trim_single")
    yield Row("trim per run: reported", trims, score.says_varies, (">=", 0.90))
    yield Row("trim per run: a false effect", trims, score.has_false_effect)
    yield Row("trim per run: an effect beside it found", trims[1:], score.is_found, (">=", 0.90))
    yield Row("twins: right set or group", ("twins",), score.is_right, (">=", 0.95))
    yield Row("pairs: right set or group", ("pairs",), score.is_right, (">=", 0.95))
    yield Row("pairs: exactly the set", ("pairs",), score.is_exact)
    yield Row("triples: right set or group", ("triples",), score.is_right, (">=", 0.90))
    yield Row("triples: exactly the set", ("triples",), score.is_exact)
    yield Row("nulls of all sorts: something said to be missing", ALL_NULLS, score.says_missing, ("<=", 0.03))
    yield Row("nulls of all sorts: these runs cannot decide", ALL_NULLS, score.is_undecided)
    yield Row("nameless: said", ("nameless",), score.is_said, (">=", 0.97))
    yield Row("nameless: its argument", ("nameless",), score.has_right_argument, (">=", 0.92))
    yield Row("nameless: half of its error held out", ("nameless",), score.halves_excess, (">=", 0.85))
    yield Row("local: said", ("local",), score.is_said, (">=", 0.80))
    yield Row("local: its argument", ("local",), score.has_right_argument)
    yield Row("local: `complete`, and the truth excluded", ("local",), score.excludes_truth, ("<=", 0.0))
    yield Row("nameless, local: falsely `complete`", NAMELESS, score.is_falsely_complete, ("<=", 0.0))
    yield Row("nameless, local: learnable share holds", NAMELESS, score.learnable_holds, (">=", 0.90))
    yield Row("null: learnable share holds 0", ("null",), score.learnable_holds, (">=", 0.90))
    yield Row("nameless, local: an effect of the library named", NAMELESS, score.has_false_effect)
    yield Row("draught: tilt or wind found", ("draught",), score.is_found)
    yield Row("draught: intervals of tilt, wind hold", ("draught",), score.intervals, ("in", 0.90))
    yield Row("history: flagged", ("history",), score.says_memory, (">=", 0.85))
    for name in hidden_craft.MEMORY:
        yield Row("- " + name, ("history",), score.says_memory, None, _has(name))
    yield Row("history: flagged falsely, all other cases", (), score.false_memory, ("<=", 0.02))
    for kind in ("jittered_link", "unequal_delays"):
        yield Row(kind + ": a false effect", (kind,), score.has_false_effect)
        yield Row(kind + ": not `unexplained`", (kind,), score.not_unexplained)
    yield Row("intervals of hidden effects hold", (), score.intervals, ("in", 0.92))
    yield Row("intervals of the body hold, right sets", (), _body, ("in", 0.92), _is_whole)
    yield Row("error held out rises by adding", (), score.made_worse, ("<=", 0.05))


def _has(name):
    return lambda result: name in result["effects"]


def _is_whole(result):
    """Whether the improved model has all effects of the truth."""
    return score.is_right(result) and result["kind"] not in NAMELESS


def _body(result):
    return score.intervals(result, effects=False)


def rate(answers):
    """Number of yes, number of answers, and the share's 95% interval (Clopper and Pearson 1934)."""
    yes, count = sum(answers), len(answers)
    return (yes, count, *shares.interval(yes, count))


def is_held(bound, yes, count):
    """Whether a share keeps a bound."""
    sense, share = bound
    if sense == "in":
        return share <= yes / count <= 0.98
    return yes <= share * count + 1e-9 if sense == "<=" else yes >= share * count - 1e-9


HEAD = ["what", "rate", "of", "95% interval", "bound", "kept"]


def lines(results, rows=None):
    """Lines of the table, each a list of strings (HEAD); rows: the questions, those of this bench if None."""
    table = [HEAD]
    for row in _rows() if rows is None else rows:
        answers = row.answers(results)
        if answers:
            yes, count, low, high = rate(answers)
            interval = "%.1f to %.1f%%" % (100 * low, 100 * high)
            kept = "" if row.bound is None else "yes" if is_held(row.bound, yes, count) else "no"
            share = "%.1f%%" % (100 * yes / count)
            table.append([row.what, share, "%d" % count, interval, bound(row.bound), kept])
    return table if rows is not None else table + _p_values(results)


def verdicts(results):
    """Lines of a table: number of cases by kind and verdict."""
    kinds = list(dict.fromkeys(r["kind"] for r in results))
    given = [(r["kind"], r["found"]["verdict"]) for r in results]
    names = sorted({verdict for _, verdict in given})
    rows = [[kind] + ["%d" % given.count((kind, name)) for name in names] for kind in kinds]
    return [["verdicts"] + names] + rows


def bound(given):
    """A bound in words."""
    if given is None:
        return ""
    sense, share = given
    return "%g to 98%%" % (100 * share) if sense == "in" else "%s %g%%" % (sense, 100 * share)


def _p_values(results):
    """Line on the p-values of disturbed nulls: the share below 1%, and whether they are uniform."""
    nulls = [r for r in results if r["kind"] == "disturbed_null"]
    values = [p for r in nulls for p in score.p_values(r)]
    if not values:
        return []
    chance = float(stats.kstest(values, "uniform").pvalue)
    yes, count, low, high = rate([p < 0.01 for p in values])
    name = "disturbed nulls: p-values below 1%; Kolmogorov-Smirnov"
    interval = "%.1f to %.1f%%" % (100 * low, 100 * high)
    kept = "yes" if chance > UNIFORM else "no"
    share = "%.1f%%" % (100 * yes / count)
    return [[name + " p = %.2g" % chance, share, "%d" % count, interval, "KS p > %g" % UNIFORM, kept]]


def markdown(table):
    """The table as Markdown."""
    head, *rest = table
    return "\n".join("| %s |" % " | ".join(line) for line in [head, ["---"] * len(head)] + rest)


def write(path, *tables):
    """Writes tables as Markdown, if there is a path."""
    if path and tables:
        with open(path, "w") as file:
            file.write("\n\n".join(map(markdown, tables)) + "\n")


def text(table):
    """The table in aligned columns."""
    widths = [max(len(line[i]) for line in table) for i in range(len(table[0]))]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(line, widths)).rstrip() for line in table)


def wrong(results):
    """A line for each case with a missed or a false effect."""
    for r in results:
        missed = sorted(set(r["hidden"]) - score.chosen(r)) if not score.is_found(r) else []
        false = sorted(score.false_effects(r))
        if missed or false:
            hidden = ",".join(sorted(r.get("effects") or r["hidden"])) or "nothing"
            hidden = r.get("formula", hidden)
            found = ",".join(r["found"]["chosen"]) or "nothing"
            words = "%s %d: hidden %s, found %s, %s"
            yield words % (r["kind"], r["seed"], hidden, found, r["found"]["verdict"])
