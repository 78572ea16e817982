"""Units of the parameters of a formula, from the units of what they multiply."""

import ast
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from ground.support.errors import GroundError

Unit = Tuple[int, int, int]  # powers of N, m, s; an angle has none
NONE, METRE = (0, 0, 0), (0, 1, 0)
NAMES: Dict[str, Unit] = {
    "u": (0, 1, -1), "v": (0, 1, -1), "r": (0, 0, -1), "x": METRE, "y": METRE, "psi": NONE, "t": (0, 0, 1),
    "pi": NONE, "lift": NONE,
}  # fmt: skip
WRENCH: Dict[str, Unit] = {"X": (1, 0, 0), "Y": (1, 0, 0), "N": (1, 1, 0)}
SAME = ("abs", "min", "max")  # functions whose result has the unit of their arguments
MAX_FORMULA = 2000  # characters of a formula


def parameters(formulas: Mapping[str, str], commands: Sequence[str]) -> Dict[str, str]:
    """The parameters of formulas by channel (X, Y, N): those names that are not variables, with their units
    where a product tells them ("?" elsewhere). commands: names of the inputs. GroundError says what is not a
    formula, or where units differ."""
    known = {**NAMES, **{name: NONE for name in commands}}
    found: Dict[str, Optional[Unit]] = {}
    broken: List[str] = []
    for channel, text in formulas.items():
        if len(text) > MAX_FORMULA:
            raise GroundError("a formula has at most %d characters" % MAX_FORMULA)
        try:
            tree = ast.parse(text.strip().replace("^", "**"), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            broken.append(text)
            continue  # the core says what is wrong, or knows more than this
        for term in _terms(tree):
            _judge(term, WRENCH[channel], known, found, text)
    if broken and not found:
        raise GroundError("'%s' is not a formula: look for a missing or superfluous sign" % broken[0])
    return {name: "?" if unit is None else words(unit) for name, unit in found.items()}


def words(unit: Unit) -> str:
    """(1, -1, 1) as "N s/m"."""

    def part(sign: int) -> str:
        powers = [(name, sign * n) for name, n in zip(("N", "m", "s"), unit) if sign * n > 0]
        return " ".join(name + (str(n) if n > 1 else "") for name, n in powers)

    over, under = part(1), part(-1)
    if not under:
        return over or "-"
    return "%s/%s" % (over or "1", "(%s)" % under if " " in under else under)


def _terms(tree: ast.expr) -> Sequence[ast.expr]:
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, (ast.Add, ast.Sub)):
        return [*_terms(tree.left), *_terms(tree.right)]
    return [tree]


def _judge(
    term: ast.expr, wanted: Unit, known: Mapping[str, Unit], found: Dict[str, Optional[Unit]], text: str
) -> None:
    called = {n.func.id for n in ast.walk(term) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    names = {n.id for n in ast.walk(term) if isinstance(n, ast.Name)} - called
    own = sorted(names - set(known))
    factor = own[0] if len(own) == 1 and own[0] in _factors(term) else None
    for name in own:
        found.setdefault(name, None)
    unit = _unit(term, {**known, **({factor: NONE} if factor else {})})
    if factor and unit is not None:
        left = tuple(a - b for a, b in zip(wanted, unit))
        if found[factor] not in (None, left):
            raise GroundError("%s: %s has two units, %s and %s" % (
                text, factor, words(found[factor] or NONE), words((left[0], left[1], left[2]))
            ))  # fmt: skip
        found[factor] = left[0], left[1], left[2]
    elif not own and unit not in (None, wanted) and not isinstance(term, ast.Constant):
        raise GroundError("%s: its unit is %s, not %s" % (text, words(unit or NONE), words(wanted)))


def _factors(term: ast.expr) -> Sequence[str]:
    """Names that multiply a term once."""
    if isinstance(term, ast.Name):
        return [term.id]
    if isinstance(term, ast.UnaryOp):
        return _factors(term.operand)
    if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Mult):
        return [*_factors(term.left), *_factors(term.right)]
    return _factors(term.left) if isinstance(term, ast.BinOp) and isinstance(term.op, ast.Div) else []


def _unit(tree: ast.expr, known: Mapping[str, Unit]) -> Optional[Unit]:
    """The unit of an expression; None where it cannot be told."""
    if isinstance(tree, ast.Constant):
        return NONE
    if isinstance(tree, ast.Name):
        return known.get(tree.id)
    if isinstance(tree, ast.UnaryOp):
        return _unit(tree.operand, known)
    if isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name) and tree.args:
        return _unit(tree.args[0], known) if tree.func.id in SAME else NONE
    if not isinstance(tree, ast.BinOp):
        return None
    a, b = _unit(tree.left, known), _unit(tree.right, known)
    if a is None or b is None:
        return None
    if isinstance(tree.op, ast.Pow):
        exponent = tree.right
        if isinstance(exponent, ast.Constant) and isinstance(exponent.value, int) and abs(exponent.value) < 9:
            return a[0] * exponent.value, a[1] * exponent.value, a[2] * exponent.value
        return None
    sign = {ast.Mult: 1, ast.Div: -1}.get(type(tree.op), 0)
    return a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2]
