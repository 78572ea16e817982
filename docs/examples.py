#!/usr/bin/python3
"""Runs the commands of pages of the documentation and compares what they print with the pages.

The blocks `sh` of a page run in order, in one shell, in an empty home folder. The block `text` between one
of them and the next shows what it prints: `...` on a line stands for any lines, at the end of a line for its
rest. Numbers may differ a little, because processors round differently. A block after the comment
`<!-- not run: REASON -->` is skipped. With --update the blocks `text` are rewritten instead. Pages of a
session run one after the other in the same shell.
"""

import argparse
import bisect
import difflib
import itertools
import os
import pathlib
import re
import subprocess
import sys
import tempfile
from typing import Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

DOCS = pathlib.Path(__file__).resolve().parent
SESSIONS = (
    ("tutorial.md",),
    ("howto/effect_yaml.md",),
    ("howto/other_craft.md",),
    ("howto/own_controller.md",),
    tuple(
        "verbs/%s.md" % verb
        for verb in (
            *("index", "info", "fit", "diagnose", "add", "compare"),
            *("simulate", "tracking", "bench", "export"),
        )
    ),
)
PAGES = [page for session in SESSIONS for page in session]
BLOCK = re.compile(r"^(<!-- not run: .+ -->\n+)?```(\w+)\n(.*?)^```$", re.M | re.S)
FILE = re.compile(r"`(\w+\.yaml)`")  # a block `yaml` is saved under the next name that the text mentions
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
REST = " ..."  # end of a line whose rest is left out
TOLERANCE = 0.02  # relative difference of numbers; that of processors' rounding, amplified by a search


class Shown(NamedTuple):
    """A block `text` and what its commands print."""

    start: int  # in the page
    end: int
    lines: List[str]
    printed: List[str]


def run(page: str) -> List[Shown]:
    """Runs the commands of a page's text. RuntimeError with their errors if one fails."""
    script = [_setup(), "set -e"]
    shown: Dict[int, Tuple[int, int, List[str]]] = {}  # by number of the commands
    blocks = list(BLOCK.finditer(page))
    number = 0
    for block, after in zip(blocks, [b.start() for b in blocks[1:]] + [len(page)]):
        skipped, language, body = block.groups()
        if skipped:
            continue
        if language == "sh":
            number += 1
            script += ['exec > "$OUTPUTS/%d"' % number, body]
        elif language == "yaml":
            name = FILE.search(page, block.end(), after)
            if name:
                script.append("cat > %s <<'END'\n%sEND" % (name.group(1), body))
        elif language == "text" and number and number not in shown:
            shown[number] = block.start(3), block.end(3), body.splitlines()
    with tempfile.TemporaryDirectory() as home, tempfile.TemporaryDirectory() as outputs:
        done = subprocess.run(
            ["bash", "--noprofile", "--norc", "-c", "\n".join(script)],
            cwd=home,
            env={"HOME": home, "OUTPUTS": outputs, "PATH": "/usr/bin:/bin", "LANG": "C.UTF-8"},
            stderr=subprocess.PIPE,
            universal_newlines=True,
        )
        if done.returncode:
            raise RuntimeError("a command of the page failed:\n" + done.stderr)
        texts = {n: pathlib.Path(outputs, str(n)).read_text().splitlines() for n in shown}
    return [Shown(*shown[n], printed=texts[n]) for n in sorted(shown)]


def _setup() -> str:
    """Command that sets the environment of this workspace."""
    spaces = os.environ.get("CMAKE_PREFIX_PATH", "").split(":")
    return "source '%s/setup.bash'" % spaces[0]


def segments(lines: Sequence[str]) -> List[List[str]]:
    """Lines between `...`; an empty first or last segment means that the block begins or ends with one."""
    found: List[List[str]] = [[]]
    for line in lines:
        if line == "...":
            found.append([])
        else:
            found[-1].append(line)
    return found


def places(lines: Sequence[str], printed: Sequence[str]) -> Iterator[Tuple[List[str], int]]:
    """The segments of a block, and where what is printed is most like them."""
    parts, at = segments(lines), 0
    for number, part in enumerate(parts):
        last = len(printed) - len(part)
        if number == 0:
            place = 0
        elif number == len(parts) - 1 and part:
            place = last
        else:
            place = max(
                range(at, max(at, last) + 1),
                key=lambda i: sum(_likeness(a, b) for a, b in zip(part, printed[i:])),
            )
        yield part, place
        at = place + len(part)


def _likeness(a: str, b: str) -> float:
    """Of two lines: 2 if they are the same, at most 1 else."""
    return 2 if same(a, b) else difflib.SequenceMatcher(None, a, b).quick_ratio()


def same(shown: str, printed: str) -> bool:
    """Whether a line of a page is what is printed, but for its rest, for spaces and for rounding."""
    if shown.endswith(REST):
        shown = shown[: -len(REST)]
        words = len(shown.split())
        printed = " ".join(printed.split()[:words])
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    return all(map(_close, NUMBER.findall(shown), NUMBER.findall(printed)))


def _close(a: str, b: str) -> bool:
    units = max(_last_digit(a), _last_digit(b))
    return abs(float(a) - float(b)) <= TOLERANCE * max(abs(float(a)), abs(float(b))) + 1.001 * units


def _last_digit(number: str) -> float:
    """What 1 in the last digit of a number is worth; 0 of an integer, which is a count."""
    mantissa, _, exponent = number.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0


def differences(shown: Shown) -> List[str]:
    """Lines of a block that are not what is printed, each with what is; empty if all are."""
    found = []
    for part, place in places(shown.lines, shown.printed):
        for i, line in enumerate(part, place):
            now = shown.printed[i] if 0 <= i < len(shown.printed) else "(nothing)"
            if not same(line, now):
                found += ["- " + line, "+ " + now]
    if "..." not in shown.lines and len(shown.printed) > len(shown.lines):
        found += ["+ " + line for line in shown.printed[len(shown.lines) :]]
    return found


def updated(shown: Shown) -> List[str]:
    """A block's lines as they are printed now; `...` stay where they are."""
    found: List[str] = []
    if "..." not in shown.lines:
        return shown.printed
    for part, place in places(shown.lines, shown.printed):
        now = shown.printed[max(place, 0) : max(place, 0) + len(part)]
        found += [*map(_cut, part, now), "..."]
    return found[:-1]


def _cut(before: str, now: str) -> str:
    """A printed line without its rest where the page has left it out."""
    if not before.endswith(REST):
        return now
    words = len(before[: -len(REST)].split())
    kept = re.match(r"(?:\s*\S+){%d}" % words, now)
    return kept.group() + REST if kept else now


def checked(path: pathlib.Path, update: bool = False) -> List[str]:
    """Differences between a page and what its commands print; update: writes the page anew."""
    return checked_session([path], update)


def checked_session(paths: Sequence[pathlib.Path], update: bool = False) -> List[str]:
    """As `checked`, for pages whose commands run one after the other in one shell."""
    texts = [path.read_text() for path in paths]
    page = "".join(texts)
    blocks = run(page)
    if not update:
        return [line for shown in blocks for line in differences(shown)]
    ends = list(itertools.accumulate(map(len, texts)))
    starts = [0, *ends]
    for shown in reversed(blocks):
        number = bisect.bisect_right(ends, shown.start)
        start = starts[number]
        text = "".join(line + "\n" for line in updated(shown))
        before, after = texts[number][: shown.start - start], texts[number][shown.end - start :]
        texts[number] = before + text + after
    for path, text in zip(paths, texts):
        path.write_text(text)
    return []


def sessions(paths: Sequence[pathlib.Path]) -> List[Tuple[pathlib.Path, ...]]:
    """The sessions of some pages; a page that has none is a session of its own."""
    known = [tuple(DOCS / name for name in session) for session in SESSIONS]
    found: List[Tuple[pathlib.Path, ...]] = []
    for path in map(pathlib.Path.resolve, paths):
        one = next((session for session in known if path in session), (path,))
        if one not in found:
            found.append(one)
    return found


def main(arguments: Optional[Sequence[str]] = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", type=pathlib.Path, default=[DOCS / name for name in PAGES])
    parser.add_argument("--update", action="store_true", help="write what is printed into the pages")
    given = parser.parse_args(arguments)
    failed = False
    for session in sessions(given.pages):
        for line in checked_session(session, given.update):
            failed = True
            print("%s: %s" % (session[0].name, line))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
