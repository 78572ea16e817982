"""Folders take only from those below them in the picture of the architecture; nothing goes in circles."""

import ast
import collections
import re

from conftest import ROOT

SOURCES = ROOT / "src" / "ground"


def python_imports():
    """Modules of the package and those of it that each imports, in functions and for type checkers, too."""
    package = SOURCES / "python" / "ground"
    modules = {}
    for path in package.rglob("*.py"):
        parts = ["ground", *path.relative_to(package).with_suffix("").parts]
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    modules.pop("ground")  # its names are loaded on first use
    for name, path in modules.items():
        words = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                words.update([node.module, *("%s.%s" % (node.module, alias.name) for alias in node.names)])
            elif isinstance(node, ast.Import):
                words.update(alias.name for alias in node.names)
        yield name, words & set(modules) - {name}


def cpp_includes():
    """Files of the core, and the headers of it that each includes."""
    globs = ("include/ground/**/*.h", "src/**/*.h", "src/**/*.cpp")
    paths = [path for glob in globs for path in SOURCES.glob(glob)]
    names = {path: str(path.relative_to(SOURCES)).replace("include/ground/", "src/") for path in paths}
    for path, name in names.items():
        found = re.findall(r'#include "(.+)"', path.read_text())
        beside = name.rpartition("/")[0] + "/"
        full = [
            re.sub("^ground/", "src/", one) if one.startswith("ground/") else beside + one for one in found
        ]
        yield name, set(full) & set(names.values())


def circles(arrows):
    """Sets of more than one node that reach each other."""

    def reached(start):
        found, waiting = set(), [start]
        while waiting:
            for other in arrows.get(waiting.pop(), set()) - found:
                found.add(other)
                waiting.append(other)
        return found

    reach = {node: reached(node) for node in arrows}
    sets = {frozenset(n for n in arrows if n in reach[node] and node in reach[n]) for node in arrows}
    return sorted(sorted(one) for one in sets if len(one) > 1)


def folders(files, separator):
    """Folders of files and those from which each takes something; a file of the first level is a folder."""
    arrows = collections.defaultdict(set)
    for name, others in files.items():
        own = name.split(separator)[1]
        arrows[own] |= {other.split(separator)[1] for other in others} - {own}
    return arrows


def test_python_modules_do_not_import_each_other():
    files = dict(python_imports())
    assert len(files) > 50
    assert (circles(files), circles(folders(files, "."))) == ([], [])


def test_cpp_files_do_not_include_each_other():
    files = dict(cpp_includes())
    assert len(files) > 50
    assert (circles(files), circles(folders(files, "/"))) == ([], [])
