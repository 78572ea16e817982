#!/usr/bin/python3
"""The promises of test/requirements.toml: limits for tests in Python, and for those in C++ by
`requirements.py --header FILE`."""

import json
import os
import sys

try:
    import tomllib  # Python 3.11
except ImportError:
    import tomli as tomllib

FOLDER = os.path.dirname(os.path.realpath(__file__))


def load():
    """Content of requirements.toml: lists "promise" and "fault" of dictionaries."""
    with open(os.path.join(FOLDER, "requirements.toml"), "rb") as file:
        return tomllib.load(file)


def limit(name):
    """The limit of a promise [s, m, ...]; KeyError if there is none of the name."""
    return {promise["name"]: promise for promise in load()["promise"]}[name]["limit"]


def sentence(promise):
    """What is promised, with its limit."""
    return promise["sentence"].format(limit="%g %s" % (promise.get("limit", 0), promise.get("unit", "s")))


def measured():
    """Worst cases of the last `make bench-faults`: the date, and by the name of the fault how it ended."""
    with open(os.path.join(FOLDER, "faults.json"), encoding="utf-8") as file:
        return json.load(file)


def header():
    """Limits as constants of C++: thrust-after-state is kThrustAfterState."""
    lines = ["#pragma once", "// Written by test/requirements.py from test/requirements.toml.", ""]
    lines += ["namespace ground {", "namespace requirements {"]
    for promise in load()["promise"]:
        if "limit" in promise:
            words = "".join(word.capitalize() for word in promise["name"].split("-"))
            lines.append("constexpr double k%s = %r;  // %s" % (words, promise["limit"], sentence(promise)))
    return "\n".join([*lines, "}  // namespace requirements", "}  // namespace ground", ""])


def changed(promise):
    """The file of the product in which the rule of a promise is taken out, from the root, and its content
    then; ValueError if the line is not in it exactly once."""
    path, line, instead = promise["without"]
    with open(os.path.join(os.path.dirname(FOLDER), path), encoding="utf-8") as file:
        lines = file.read().split("\n")
    places = [i for i, one in enumerate(lines) if one.strip() == line]
    if len(places) != 1:
        raise ValueError(
            "promise %d: %s has its line %d times, not once: %s"
            % (promise["number"], path, len(places), line)
        )
    (place,) = places
    indent = len(lines[place]) - len(lines[place].lstrip())
    lines[place] = lines[place][:indent] + instead
    return path, "\n".join(lines)


def main():
    if len(sys.argv) != 3 or sys.argv[1] != "--header":
        sys.exit("usage: requirements.py --header FILE")
    text, path = header(), sys.argv[2]
    os.makedirs(os.path.dirname(path), exist_ok=True)
    if not os.path.exists(path) or open(path).read() != text:
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)


if __name__ == "__main__":
    main()
