"""Folders take only from those below them in the picture of the architecture; nothing goes in circles."""

import ast
import collections
import re
import subprocess
import sys

import pytest

from conftest import ROOT
from ground.support.public import HOMES

SOURCES = ROOT / "src" / "ground"


def python_modules():
    """The modules of the package and their syntax trees, without `ground` itself, which is above all."""
    package = SOURCES / "python" / "ground"
    for path in package.rglob("*.py"):
        parts = ["ground", *path.relative_to(package).with_suffix("").parts]
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        if name != "ground":
            yield name, ast.parse(path.read_text())


def imported(tree):
    """What a module imports, in functions and for type checkers, too: its dotted name. A public name that is
    imported from `ground` is that of its module, but for type checkers, which follow `public`."""
    typed = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            typed.update(ast.walk(node))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            for alias in node.names:
                is_public = node.module == "ground" and alias.name in HOMES
                if not (is_public and node in typed):
                    yield HOMES[alias.name] if is_public else "%s.%s" % (node.module, alias.name)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def python_imports():
    """Modules of the package and those of it that each imports."""
    modules = dict(python_modules())
    for name, tree in modules.items():
        yield name, set(imported(tree)) & set(modules) - {name}


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


def test_no_module_imports_the_whole_package():
    """A room calls a verb of a room above it by `public`, which loads the room when it is called."""
    upward = [
        name
        for name, tree in python_modules()
        for node in ast.walk(tree)
        if isinstance(node, ast.Import) and "ground" in [alias.name for alias in node.names]
    ]
    assert not upward


@pytest.mark.parametrize("verb, most", [("read", 35), ("fit", 50), ("diagnose", 90)])
def test_a_verb_loads_what_it_needs(verb, most):
    count = "len([name for name in sys.modules if name.startswith('ground.')])"
    code = "import sys, ground; ground.%s; print(%s)" % (verb, count)
    assert int(subprocess.check_output([sys.executable, "-c", code])) <= most


def test_each_class_has_a_name_of_its_own():
    homes = collections.defaultdict(list)
    for name, tree in python_modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(name)
    assert {name: found for name, found in homes.items() if len(found) > 1} == {}


def test_cpp_files_do_not_include_each_other():
    files = dict(cpp_includes())
    assert len(files) > 50
    assert (circles(files), circles(folders(files, "/"))) == ([], [])
