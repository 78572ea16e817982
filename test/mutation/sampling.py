"""Mutants of source files: lines with one operator, constant or statement changed."""

import contextlib
import io
import pathlib
import random
from dataclasses import dataclass

from universalmutator import mutator

ROOT = pathlib.Path(__file__).resolve().parents[2]
HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = ROOT / "src" / "ground"
CORE = ("model", "identification", "link", "safety", "control", "estimation", "simulation")


@dataclass(frozen=True)
class Mutant:
    """A changed line of a file."""

    path: str  # from the root of the workspace
    line: int  # counted from 1
    before: str
    after: str

    @property
    def key(self):
        """What distinguishes it from other mutants."""
        return (self.path, self.line, self.before, self.after)

    def text(self, root=ROOT):
        """The whole file with the changed line, from a copy of the workspace."""
        lines = (root / self.path).read_text().splitlines(keepends=True)
        lines[self.line - 1] = self.after + "\n"
        return "".join(lines)


def folder(path):
    """Folder of the core that a file is in."""
    parts = pathlib.PurePath(path).parts
    return parts[4] if parts[2] == "include" else parts[3]


def drawn(only, seed):
    """All mutants of the core's files whose path contains `only`, in random order, so that the first n are a
    sample of n."""
    places = [PACKAGE / place / name for place in ("src", "include/ground") for name in CORE]
    files = sorted(p for place in places for p in place.rglob("*") if p.suffix in (".cpp", ".h"))
    found = [mutant for path in files if only in str(path) for mutant in _of_file(path)]
    random.Random(seed).shuffle(found)
    return [mutant for mutant in found if "(2 * 0.0)" not in mutant.after]  # which changes nothing


def _of_file(path):
    rules = str(HERE / "cpp.rules")
    lines = path.read_text().splitlines(keepends=True)
    name = str(path.relative_to(ROOT))
    with contextlib.redirect_stdout(io.StringIO()):  # it reports what it does
        found = mutator.mutants_regexp(lines, [rules], ignorePatterns=[], ignoreStringOnly=True)
    for number, line, *_ in found:
        yield Mutant(name, number, lines[number - 1].rstrip("\n"), line.rstrip("\n"))
