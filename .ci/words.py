#!/usr/bin/python3
"""Reports phrases of words.txt in files, also across the end of a line; of C++ headers in comments only."""

import pathlib
import re
import sys

LIST = pathlib.Path(__file__).with_name("words.txt")
GAP = r"(?:[^\S\n]+|[^\S\n]*\n[^\S\n]*(?:(?://[/!]?<?|#+|>|[-*])[^\S\n]+)?)"  # between two words


def phrases():
    """Yields a pattern, a phrase and what to write in its place."""
    for line in LIST.read_text().splitlines():
        if not line.startswith("#"):
            phrase, _, instead = line.partition(" -> ")
            words = GAP.join(map(re.escape, phrase.split()))
            yield re.compile(r"(?<!\w)%s(?!\w)" % words, re.I), phrase, instead


def comments(code):
    """C++ code without what is not a comment; lines stay where they are."""
    return "\n".join(line[line.find("//") :] if "//" in line else "" for line in code.split("\n"))


def main(names):
    listed, found = list(phrases()), False
    for name in names:
        text = pathlib.Path(name).read_text()
        text = comments(text) if name.endswith(".h") else text
        for pattern, phrase, instead in listed:
            for match in pattern.finditer(text):
                found = True
                print(
                    '%s:%d: "%s": write "%s"'
                    % (name, text.count("\n", 0, match.start()) + 1, phrase, instead)
                )
    return int(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
