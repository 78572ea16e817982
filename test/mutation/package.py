"""Mutants of ground.recordings and ground.analysis: which tests in Python execute what, and a copy of the
package that holds mutants."""
import ast
import collections
import concurrent.futures
import importlib.util
import json
import os
import pathlib
import re
import shutil
import sys
import types
import xml.etree.ElementTree

import coverage

import commands
from sampling import PACKAGE, ROOT

FOLDER = ROOT / "build" / "mutation" / "python"
TESTS = FOLDER / "tests.json"
# Tests of nodes and of packages take minutes and are for others than these modules.
OTHERS = ("launch", "downstream", "faults", "starved", "wheel", "docs", "packages", "live_plot", "progress")
# Processor time of a mutant's tests: what they took with counters, by the clock, and so much more [s].
MORE = 20
PATIENCE = 60  # tests of a mutant take about this long [s]; slower ones are not asked
START = 0.1  # what a test takes beside itself [s]
SETTINGS = """[run]
dynamic_context = test_function
concurrency = thread,multiprocessing
parallel = True
source = %s
data_file = %s
"""


def count(jobs, only=()):
    """Runs the files of tests that have changed since they were counted, all or those named in `only`, and
    writes which tests execute which lines, and how long they take."""
    _copy_package(FOLDER / "counted")
    files = sorted((ROOT / "test" / "python").glob("test_*.py"))
    named = {file.stem[len("test_") :]: file for file in files}
    unknown = sorted(set(only) - set(named))
    if unknown:
        raise SystemExit("test/python has no test_%s.py" % unknown[0])
    asked = [named[name] for name in only or sorted(set(named) - set(OTHERS))]
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        list(pool.map(_counted, [file for file in asked if not _is_counted(file)]))
    seconds, lines = {}, collections.defaultdict(lambda: collections.defaultdict(list))
    for file in files:
        if _report(file).exists():
            took = _seconds(file)
            seconds.update(took)
            for path, line, test in _executed(file, took):
                lines[path][str(line)].append(test)
    TESTS.write_text(json.dumps({"seconds": seconds, "lines": lines}))


def _copy_package(folder):
    """Copies the package, with what has been built for it."""
    shutil.rmtree(str(folder), ignore_errors=True)
    shutil.copytree(str(PACKAGE / "python" / "ground"), str(folder / "ground"))
    built = pathlib.Path(importlib.util.find_spec("ground._core").origin).resolve().parent
    for made in [*built.glob("_core*.so"), built / "cfg"]:
        os.symlink(str(made), str(folder / "ground" / made.name))


def _environment(folder):
    """That of programs that use the copy of the package in a folder."""
    path = "%s:%s" % (folder, os.environ.get("PYTHONPATH", ""))
    return {"PYTHONPATH": path, "PYTHONPYCACHEPREFIX": str(folder / "compiled")}


def _report(file):
    return FOLDER / file.stem / "junit.xml"


def _is_counted(file):
    report = _report(file)
    return report.exists() and report.stat().st_mtime > file.stat().st_mtime


def _counted(file):
    """Runs a file of tests with counters."""
    folder = FOLDER / file.stem
    shutil.rmtree(str(folder), ignore_errors=True)
    folder.mkdir()
    (folder / "settings").write_text(SETTINGS % (FOLDER / "counted" / "ground", folder / "data"))
    made = folder / "unfinished.xml"
    command = [sys.executable, "-m", "coverage", "run", "--rcfile=%s" % (folder / "settings"), "-m"]
    command += ["pytest", "-q", "-p", "no:cacheprovider", str(file), "--junit-xml=%s" % made]
    done = commands.run(command, 3600, ROOT, _environment(FOLDER / "counted"))
    if not made.exists():
        raise SystemExit("%s does not run:\n%s" % (file, done.output[-3000:]))
    counted = coverage.Coverage(config_file=str(folder / "settings"))
    counted.combine()
    made.rename(_report(file))


def _seconds(file):
    """Durations of the tests in a file that pass, and of the file as a whole if all do [s]."""
    found, failed = {file.stem: START}, set()
    for case in xml.etree.ElementTree.parse(str(_report(file))).iter("testcase"):
        took = float(case.get("time"))
        found[file.stem] += took
        name = "%s.%s" % (file.stem, case.get("name").split("[")[0])
        found[name] = found.get(name, START) + took
        if case.find("failure") is not None or case.find("error") is not None:
            print("%s fails without any mutation and is not asked" % name)
            failed |= {name, file.stem}
    return {name: took for name, took in found.items() if name not in failed}


def _executed(file, seconds):
    """(path, line, test) for each line that a file of tests executes. What is executed outside of tests,
    in fixtures and other threads and processes, is for the whole file."""
    data = coverage.CoverageData(str(FOLDER / file.stem / "data"))
    data.read()
    for path in data.measured_files():
        inner = os.path.relpath(path, str(FOLDER / "counted"))
        name = str(PACKAGE.relative_to(ROOT) / "python" / inner)
        for line, contexts in data.contexts_by_lineno(path).items():
            tests = {context or file.stem for context in contexts}
            for test in tests & set(seconds):
                yield name, line, test


class Tree:
    """A copy of the package in which one mutant at a time is tested."""

    def __init__(self, folder):
        self._folder = folder
        self._path = folder / PACKAGE.relative_to(ROOT) / "python"
        found = json.loads(TESTS.read_text())
        self._seconds, self._lines = found["seconds"], found["lines"]
        self._longest = collections.defaultdict(float)
        for test, seconds in self._seconds.items():
            if "." in test:
                file = test.split(".")[0]
                self._longest[file] = max(self._longest[file], seconds)
        _copy_package(self._path)

    def judge(self, mutant):
        """What the tests say of a mutant: a dictionary for the table."""
        path = self._folder / mutant.path
        original, text = path.read_text(), mutant.text(self._folder)
        try:
            if _meaning(text) == _meaning(original):
                return {"outcome": "equivalent", "why": "the same program"}
        except SyntaxError:
            return {"outcome": "invalid"}
        before = path.stat()
        try:
            path.write_text(text)
            # Compiled files are recognised by their source's time [s] and size.
            os.utime(str(path), (before.st_atime, before.st_mtime - 1000))
            return self._judged(self._tests(mutant))
        finally:
            path.write_text(original)
            os.utime(str(path), (before.st_atime, before.st_mtime))

    def _tests(self, mutant):
        """Tests to run. A line that runs when its module is imported matters wherever the module is used:
        first tests that execute the module's functions are asked, then whole files that import it, because
        their tests may only read its constants."""
        lines = self._lines.get(mutant.path, {})
        inside = _statement(self._folder / mutant.path, mutant.line)
        found = lines.values() if inside is None else [lines.get(str(line), ()) for line in inside]
        tests = {test for those in found for test in those}
        files = {test for test in tests if "." not in test} if inside is None else set()
        return self._quickest(tests - files) + self._quickest(files)

    def _quickest(self, tests):
        """Some of the tests, those of quick files first, until PATIENCE is over."""
        chosen = collections.defaultdict(list)
        total = 0.0
        for test in sorted(tests, key=lambda test: self._shared(test) + self._seconds[test]):
            file = test.split(".")[0]
            total += self._seconds[test] + (0 if file in chosen else self._shared(test))
            if chosen and total > PATIENCE:
                break
            chosen[file].append(test)
        # Tests of a file in a row, because they share what takes long.
        return [test for part in chosen.values() for test in part]

    def _shared(self, test):
        """What a test may take because tests of its file share it, and another one had taken it when it was
        counted: no longer than the longest one [s]."""
        file = test.split(".")[0]
        return self._longest.get(file, 0.0) if "." in test else 0.0

    def _judged(self, tests):
        if not tests:
            return {"outcome": "survived", "tests": 0}
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        shared = {test.split(".")[0]: self._shared(test) for test in tests}
        limit = MORE + sum([*shared.values(), *(self._seconds[test] for test in tests)])
        command += [_node(test) for test in tests]
        done = commands.run(command, limit, ROOT, _environment(self._path))
        if done.timed_out or done.status:
            failed = re.search(r"^(FAILED|ERROR) test/python/(\S+)", done.output, re.MULTILINE)
            by = failed.group(2) if failed else "the end of pytest"
            return {"outcome": "killed", "by": by, "timeout": done.timed_out}
        return {"outcome": "survived", "tests": len(tests)}


def _node(test):
    """pytest's name of a test, or of a file of tests."""
    file, _, name = test.partition(".")
    return "test/python/%s.py%s" % (file, "::" + name.replace(".", "::") if name else "")


def prepared(number):
    """The copy of a worker."""
    return Tree(FOLDER / ("package_%d" % number))


def _statement(path, line):
    """The lines of the statement inside a function that a line is part of, of a compound one its head;
    None for a line that runs when the module is imported."""
    inside, within = None, False
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.stmt)]
    for node in sorted(nodes, key=lambda node: (node.lineno, -node.end_lineno)):
        if node.lineno <= line <= node.end_lineno:
            body = getattr(node, "body", None)
            end = body[0].lineno - 1 if body else node.end_lineno
            inside = range(node.lineno, max(node.lineno, end) + 1)
            is_function = isinstance(node, (ast.FunctionDef, ast.ClassDef))
            within = within or isinstance(node, ast.FunctionDef) and line not in inside
            if is_function and line in inside and not within:
                return None
    return inside if within else None


def _meaning(text):
    """A program as it is compiled, without docstrings, comments and positions."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not _is_docstring(one)] or [ast.Pass()]
    return _instructions(compile(ast.fix_missing_locations(tree), "", "exec"))


def _instructions(code):
    """What a code object does, with the code objects inside it."""
    inside = [
        _instructions(one) if isinstance(one, types.CodeType) else repr(one) for one in code.co_consts
    ]
    return code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, inside


def _is_docstring(node):
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
