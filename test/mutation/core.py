"""Mutants of the C++ core: which unit tests execute what, and a copy of the workspace that builds mutants.
As a program, `core.py JOBS`, it counts what the unit tests execute; gcovr has to be asked next."""

import collections
import concurrent.futures
import filecmp
import json
import os
import re
import shutil
import subprocess
import sys

from sampling import PACKAGE, ROOT

import commands

COUNTED = ROOT / "build" / "coverage"  # the build that counts executed lines
COUNTS = ROOT / "build" / "mutation" / "counts"
REPORT = COUNTS / "lines.json"  # what gcovr says of all unit tests together
HEAD = 32  # bytes of a .gcda file with stamps and the maximum of all counters of a library
SLACK = 10  # a test of a mutant may take this many times what it took without [processor time] ...
LEAST = 10  # ... but at least so long [s]
AT_FIRST = 3  # tests that are built at first, because they kill most mutants


def count(jobs):
    """Runs unit tests with counters, those that have changed since they were counted. Counts of each go to
    a folder of its own, and their sums into the build, where gcovr finds them."""
    names = (COUNTED / "ground_unit_tests.txt").read_text().split()
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        found = dict(zip(names, pool.map(_counted, names)))
    _add_up([COUNTS / name / "all" for name in names])
    (COUNTS / "tests.json").write_text(json.dumps(found))


def _counted(name):
    """How long a test takes [s] and objects of which it executes more than any program does."""
    program, known = COUNTED / "devel" / "lib" / "ground" / name, COUNTS / name / "found.json"
    parts = [program, *(COUNTED / "devel" / "lib").glob("libground_*.so")]
    if known.exists() and known.stat().st_mtime > max(part.stat().st_mtime for part in parts):
        return json.loads(known.read_text())
    shutil.rmtree(str(known.parent), ignore_errors=True)
    for kind, arguments in (("none", ["--gtest_list_tests"]), ("all", ["--gtest_brief=1"])):
        environment = {"GCOV_PREFIX": str(known.parent / kind), **_libraries(COUNTED)}
        done = commands.run([str(program)] + arguments, 1200, ROOT, environment)
        if done.status:
            raise SystemExit("%s fails without any mutation:\n%s" % (name, done.output[-3000:]))
    found = {"seconds": done.seconds, "executed": sorted(_executed(name))}
    known.write_text(json.dumps(found))
    return found


def _libraries(build):
    """Makes programs take the libraries of a build, also where a workspace was sourced."""
    return {"LD_LIBRARY_PATH": str(build / "devel" / "lib")}


def _executed(name):
    """Objects of which a test executes more than what any program executes when it starts."""
    started, ran = COUNTS / name / "none", COUNTS / name / "all"
    for path in ran.rglob("*.gcda"):
        inner = path.relative_to(ran)
        before = started / inner
        if not before.exists() or before.read_bytes()[HEAD:] != path.read_bytes()[HEAD:]:
            yield str((ROOT.parent / "/" / inner).relative_to(COUNTED))[: -len("gcda")] + "o"


def _add_up(folders):
    total = folders[0]
    for i, folder in enumerate(folders[1:]):
        into = COUNTS / ("total_%d" % (i % 2))
        shutil.rmtree(into, ignore_errors=True)
        commands.waited(["gcov-tool", "merge", "-o", str(into), str(total), str(folder)], COUNTS)
        total = into
    for path in COUNTED.rglob("*.gcda"):
        path.unlink()
    for path in total.rglob("*.gcda"):
        shutil.copy(str(path), str(ROOT.parent / "/" / path.relative_to(total)))


class Covering:
    """Which unit tests execute a line of the core, by the counts and by what gcovr reports of them."""

    def __init__(self):
        found = json.loads((COUNTS / "tests.json").read_text())
        self.seconds = {name: test["seconds"] for name, test in found.items()}
        self._executed = {name: set(test["executed"]) for name, test in found.items()}
        self._counts = collections.defaultdict(collections.Counter)
        for file in json.loads(REPORT.read_text())["files"]:
            for line in file["lines"]:  # several for a line of a template
                self._counts[file["file"]][line["line_number"]] += line["count"]
        self._objects = _objects_by_file()

    def tests(self, mutant):
        """Names of the tests to run, the quickest first; none if no test executes the line."""
        counts = self._counts.get(mutant.path, {})
        is_source = mutant.path.endswith(".cpp")
        if mutant.line in counts and not counts[mutant.line] or is_source and not sum(counts.values()):
            return []
        objects = self._objects.get(mutant.path, set())
        touching = [name for name, executed in self._executed.items() if executed & objects]
        return sorted(touching, key=self.seconds.get)


def _objects_by_file():
    """Objects that are compiled from each source and header, by ninja's record."""
    found = {}
    for line in commands.waited(["ninja", "-t", "deps"], COUNTED).splitlines():
        if not line.startswith(" "):
            built = line.split(":")[0]
            continue
        path = os.path.normpath(os.path.join(str(COUNTED), line.strip()))
        if path.startswith(str(PACKAGE)):
            found.setdefault(os.path.relpath(path, str(ROOT)), set()).add(built)
    return found


def prepared(number):
    """The copy of a worker."""
    return Tree(ROOT / "build" / "mutation" / ("tree_%d" % number), Covering())


def _copy_changed(source, target):
    """Copies the files of a build that differ in time or size, with their times, so that ninja finds them
    up to date."""
    for path in source.rglob("*"):
        other = target / path.relative_to(source)
        if path.is_symlink() or not path.is_file():
            continue
        wanted = path.stat()
        there = other.stat() if other.exists() else None
        if not there or (wanted.st_mtime_ns, wanted.st_size) != (there.st_mtime_ns, there.st_size):
            other.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(str(path), str(other))


class Tree:
    """A copy of the workspace in which one mutant at a time is built and tested."""

    def __init__(self, folder, covering):
        """Brings the copy up to date and builds it without mutations."""
        self._folder = folder
        self._covering = covering
        self._build = folder / "build"
        self._pristine = folder.with_name(folder.name + "_pristine")
        if self._pristine.exists():  # an interrupted run may have left a mutant
            _copy_changed(self._pristine, self._build)
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.check_output(listed, cwd=str(ROOT)).decode().split("\0"):
            source, copy = ROOT / name, self._folder / name
            if source.is_file() and not (copy.exists() and filecmp.cmp(str(source), str(copy), False)):
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(str(source), str(copy))
        if not (self._build / "build.ninja").exists():
            commands.waited([".ci/configure", "mutants"], self._folder)
        commands.waited(["ninja", "-j1", "ground_unit_tests"], self._build)
        _copy_changed(self._build, self._pristine)

    def judge(self, mutant):
        """What the unit tests say of a mutant: a dictionary for the table."""
        tests = self._covering.tests(mutant)
        path = self._folder / mutant.path
        kept = path.with_name(path.name + ".kept")
        shutil.copy2(str(path), str(kept))  # with its time, so that ninja finds nothing to do
        try:
            path.write_text(mutant.text(self._folder))
            return self._judged(mutant, tests)
        finally:
            os.replace(str(kept), str(path))
            _copy_changed(self._pristine, self._build)

    def _judged(self, mutant, tests):
        if mutant.path.endswith(".cpp") and not self._compiles([self._named(mutant.path) + "^"]):
            return {"outcome": "invalid"}
        if mutant.path.endswith(".cpp") and self._is_unchanged():
            return {"outcome": "equivalent", "why": "the same object code"}
        for part in (tests[:AT_FIRST], tests[AT_FIRST:]):
            if part and not self._compiles(part):
                return {"outcome": "invalid"}
            if part and self._is_unchanged():
                return {"outcome": "equivalent", "why": "the same object code"}
            for test in part:
                program = str(self._build / "devel" / "lib" / "ground" / test)
                limit = max(LEAST, SLACK * self._covering.seconds[test])
                environment = {"GTEST_FAIL_FAST": "1", "GTEST_BRIEF": "1", **_libraries(self._build)}
                done = commands.run([program], limit, self._folder, environment)
                if done.timed_out:
                    return {"outcome": "killed", "by": test, "timeout": True}
                if done.status:
                    failed = re.search(r"\[  FAILED  \] (\S+)", done.output)
                    return {"outcome": "killed", "by": failed.group(1) if failed else test}
        return {"outcome": "survived", "tests": len(tests)}

    def _named(self, path):
        """A source file as ninja calls it: CMake writes other paths when ninja runs it again."""
        absolute = str(self._folder / path)
        return absolute if absolute in (self._build / "build.ninja").read_text() else "../" + path

    def _compiles(self, targets):
        done = commands.run(["ninja", "-j1"] + targets, 3600, self._build)
        if "ninja: error" in done.output:  # not of the compiler: every mutant would seem invalid
            raise SystemExit(done.output)
        return done.status == 0

    def _is_unchanged(self):
        """Whether all objects that were compiled again are as they were without the mutation."""
        for path in self._build.rglob("*.o"):
            other = self._pristine / path.relative_to(self._build)
            if path.stat().st_mtime_ns != other.stat().st_mtime_ns:
                if not filecmp.cmp(str(path), str(other), False):
                    return False
        return True


if __name__ == "__main__":
    count(int(sys.argv[1]))
