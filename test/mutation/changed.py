"""Test programs in which one source file of the core is changed. Only that file is compiled: what a program
itself defines comes before what a library defines."""

import os
import pathlib
import re
import shlex
import shutil
import subprocess
import tempfile

import commands

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = ROOT / "build"
SECONDS = 120  # longest run of a test program [processor time]


class Changed:
    """Compiles changed files and runs test programs of build/ with them. The programs have to be built."""

    def __init__(self, build=BUILD):
        self._build = build
        self._commands = {}
        self._links = {}
        self._kept = tempfile.TemporaryDirectory(dir=str(build))

    def _of(self, target):
        """The commands of a target, the last of which links it."""
        if target not in self._commands:
            told = subprocess.check_output(["ninja", "-t", "commands", target], cwd=str(self._build))
            self._commands[target] = told.decode().splitlines()
        return self._commands[target]

    def _compiler(self, path):
        """The command that compiles a file, without its source and output."""
        library = "ground_" + pathlib.PurePath(path).parts[3]
        (line, *_) = [
            one for one in self._of(library) if " -c " in one and "CMakeFiles/%s.dir" % library in one
        ]
        words = shlex.split(line)
        for option in ("-MT", "-MF", "-o", "-c"):
            at = words.index(option)
            del words[at : at + 2]
        return [word for word in words if word not in ("-MD", "-O3", "-Werror")] + ["-O1", "-w"]

    def _linker(self, program):
        """The command that links a program, of its objects as they are at the first call."""
        if program not in self._links:
            words = shlex.split(self._of(program)[-1].replace(": &&", "", 1).rsplit("&& :", 1)[0])
            for i, word in enumerate(words):
                if word.endswith(".o"):
                    words[i] = os.path.join(self._kept.name, word.replace("/", "_"))
                    shutil.copy(str(self._build / word), words[i])
            self._links[program] = words
        return list(self._links[program])

    def verdict(self, path, text, program, tests="*", environment=None):
        """What `tests` of a program say when the file `path` (from the root) has the content `text`: a
        dictionary with the outcome "invalid", "survived" or "killed", and by what. A program that ends in .py
        is a file of test/python."""
        if program.endswith(".py"):
            return self._python(path, text, program, tests)
        with tempfile.TemporaryDirectory(dir=str(self._build)) as folder:
            source = pathlib.Path(folder) / pathlib.PurePath(path).name
            source.write_text(text)
            changed, linked = str(source.with_suffix(".o")), os.path.join(folder, "program")
            here = "-I%s" % (ROOT / path).parent
            made = self._compiler(path) + [here, "-c", str(source), "-o", changed]
            if commands.run(made, 600, self._build).status:
                return {"outcome": "invalid"}
            words = self._linker(program)
            at = words.index("-o")
            words[at : at + 2] = [changed, "-o", linked]
            ended = commands.run(words, 600, self._build)
            if ended.status:
                raise SystemExit("%s cannot be linked with a changed %s:\n%s" % (program, path, ended.output))
            return self._run(linked, tests, environment)

    def _python(self, path, text, program, tests):
        """The package is copied, because its modules import each other. A program is changed in place, in a
        mount name space that only its test sees."""
        package = ROOT / "src" / "ground" / "python" / "ground"
        test = "%s::%s" % (ROOT / "test" / "python" / program, tests)
        words = ["/usr/bin/python3", "-m", "pytest", "-q", "-x", "-rs", "-p", "no:cacheprovider", test]
        environment = {"PYTHONDONTWRITEBYTECODE": "1"}
        with tempfile.TemporaryDirectory(dir=str(self._build)) as folder:
            if package in (ROOT / path).parents:
                copy = pathlib.Path(folder) / "ground"
                shutil.copytree(str(package), str(copy), ignore=shutil.ignore_patterns("__pycache__"))
                (copy / (ROOT / path).relative_to(package)).write_text(text)
                environment["PYTHONPATH"] = folder + os.pathsep + os.environ.get("PYTHONPATH", "")
            else:
                changed = pathlib.Path(folder) / "changed"
                changed.write_text(text)
                changed.chmod(0o755)
                mounted = 'mount --bind "$0" "$1" && shift && exec "$@"'
                words = ["unshare", "--mount", "sh", "-c", mounted, str(changed), str(ROOT / path), *words]
            ended = commands.run(words, SECONDS, ROOT, environment)
        if ended.status not in (0, 1) or " skipped" in ended.output:
            raise SystemExit("%s says nothing:\n%s" % (test, ended.output[-3000:]))
        return {"outcome": "killed", "by": tests} if ended.status else {"outcome": "survived"}

    def _run(self, linked, tests, environment):
        ended = commands.run(
            [linked, "--gtest_filter=" + tests],
            SECONDS,
            ROOT,
            {"GTEST_FAIL_FAST": "1", "GTEST_BRIEF": "1", **(environment or {})},
        )
        if ended.timed_out:
            return {"outcome": "killed", "by": "timeout"}
        if ended.status == 0:
            ran = re.search(r"\[==========\] (\d+) tests? from .* ran", ended.output)
            if not ran or ran.group(1) == "0":
                raise SystemExit("no test is called %s" % tests)
            return {"outcome": "survived"}
        failed = re.search(r"\[  FAILED  \] ([\w./]+)", ended.output)
        broken = re.search(r'Which is: "([^"]*)"\n\s*""', ended.output)
        by = broken.group(1) if broken else failed.group(1) if failed else ended.output[-300:]
        return {"outcome": "killed", "by": by, "test": failed.group(1) if failed else ""}
