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
CORE = ("model", "identification", "link", "control", "estimation", "simulation")
ANALYSIS = ("recordings", "analysis")


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

    @property
    def folder(self):
        """Folder of the core, or of the package."""
        parts = pathlib.PurePath(self.path).parts
        return parts[4] if parts[2] in ("python", "include") else parts[3]

    def text(self, root=ROOT):
        """The whole file with the changed line, from a copy of the workspace."""
        lines = (root / self.path).read_text().splitlines(keepends=True)
        lines[self.line - 1] = self.after + "\n"
        return "".join(lines)


def core_files():
    """Sources and headers of the C++ core."""
    places = [PACKAGE / place / name for place in ("src", "include/ground") for name in CORE]
    return sorted(p for place in places for p in place.rglob("*") if p.suffix in (".cpp", ".h"))


def analysis_files():
    """Modules of ground.recordings and ground.analysis."""
    places = [PACKAGE / "python" / "ground" / name for name in ANALYSIS]
    return sorted(path for place in places for path in place.rglob("*.py"))


def drawn(files, seed):
    """All mutants of the files in random order, so that the first n are a sample of n."""
    found = [mutant for path in files for mutant in _of_file(path)]
    random.Random(seed).shuffle(found)
    return found


def _of_file(path):
    rules = str(HERE / ("python.rules" if path.suffix == ".py" else "cpp.rules"))
    lines = path.read_text().splitlines(keepends=True)
    name = str(path.relative_to(ROOT))
    with contextlib.redirect_stdout(io.StringIO()):  # it reports what it does
        found = mutator.mutants_regexp(lines, [rules], ignorePatterns=[], ignoreStringOnly=True)
    for number, line, *_ in found:
        yield Mutant(name, number, lines[number - 1].rstrip("\n"), line.rstrip("\n"))
