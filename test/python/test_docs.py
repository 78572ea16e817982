"""README and docs: links have targets, and the programs accept the printed commands."""

import argparse
import ast
import contextlib
import io
import re
import runpy
import shlex
import subprocess
import xml.etree.ElementTree as ElementTree
from unittest import mock

import pytest

import ground
from conftest import ROOT, SCRIPTS, identify
from ground import _core, cli

PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES += sorted((ROOT / "docs").rglob("*.md"))
IMAGE_OR_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```(\S*)\n(.*?)^```$", re.M | re.S)


def name_of(page):
    return str(page.relative_to(ROOT))


def prose(text):
    return FENCE.sub("", text)


def anchors(text):
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    for heading in re.findall(r"^#+ +(.*)$", prose(text), re.M):
        yield re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def generated(text):
    return "{from-code}" in text


def broken_links(page):
    for target in IMAGE_OR_LINK.findall(prose(page.read_text())):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            yield target
        elif anchor and file.suffix == ".md":
            text = file.read_text()
            if not generated(text) and anchor not in anchors(text):  # sphinx checks generated pages
                yield target


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_have_targets(page):
    assert list(broken_links(page)) == []


def command_lines(text, start):
    """Words after `start` of every command line of a page that begins with it, in fences and in `code`.
    Skips comments, and lines with placeholders (VERB, ...)."""
    fences = [body for language, body in FENCE.findall(text) if language == "sh"]
    lines = "\n".join(fences).replace("\\\n", " ").splitlines()
    lines += [code.replace("\n", " ") for code in re.findall(r"`([^`]+)`", prose(text))]
    for line in lines:
        command = line.partition(start + " ")[2]
        command = re.sub(r"\$\([^)]*\)|\$\w+", "1", command)  # the shell substitutes these
        words = shlex.split(re.split(r" [|&;]|[;|]", command)[0], comments=True)
        if len(words) > 1 and not re.search(r"\b(VERB|NAME)\b|\.\.\.", command):
            yield words


class Parsed(BaseException):
    """Raised by the patched parsers instead of running the command."""


def run_as(program, words):
    """Runs the main function of a program with a user's words."""
    if program == "identify":
        cli.main(words)
    elif program in cli.PROGRAMS:
        cli.program(program, words)
    else:
        with mock.patch("sys.argv", [program] + words):
            runpy.run_path(str(SCRIPTS / program), run_name="__main__")


def complaint(program, words):
    """The error of the program's parser about the words, empty if it accepts them. The command is not
    run."""
    parse_args = argparse.ArgumentParser.parse_args

    def only_parse(parser, arguments=None, namespace=None):
        parse_args(parser, arguments, namespace)
        raise Parsed

    out, err = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        stack.enter_context(mock.patch.object(cli, "_run", side_effect=Parsed))
        stack.enter_context(mock.patch.object(argparse.ArgumentParser, "parse_args", only_parse))
        try:
            run_as(program, words)
        except Parsed:
            return ""
        except SystemExit as end:  # status 0 after --help
            return "" if end.code == 0 and out.getvalue() else err.getvalue() or str(end.code)
    return "has no parser"


def complaints(page):
    text = page.read_text()
    for program, *words in command_lines(text, "rosrun ground"):
        problem = complaint(program, words)
        if problem:
            yield "%s %s: %s" % (program, " ".join(words), problem.splitlines()[-1])
    for file, *arguments in command_lines(text, "roslaunch ground"):
        launch = ElementTree.parse(str(ROOT / "launch" / file)).getroot()
        known = {arg.get("name") for arg in launch.findall("arg")}
        for argument in arguments:
            if argument.partition(":=")[0] not in known:
                yield "%s does not take %s" % (file, argument)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_printed_commands_are_accepted(page):
    assert list(complaints(page)) == []


def test_the_version_is_that_of_the_newest_release_in_the_change_log():
    packages = [ROOT / "src" / name / "package.xml" for name in ("ground", "ground_msgs")]
    versions = {ElementTree.parse(str(path)).getroot().findtext("version") for path in packages}
    changes = (ROOT / "CHANGELOG.md").read_text()
    newest, *older = re.findall(r"^## \[(.+)\]( - \d{4}-\d\d-\d\d)?$", changes, re.M)
    assert newest == ("Unreleased", "") and all(date for _, date in older)
    assert versions == {older[0][0]} == {_core.version} == {ground.__version__}
    assert ground.__version__ in identify("--version").stdout


def test_the_reference_has_the_text_of_attributes_once_and_no_types_of_it():
    from sphinx.ext.napoleon import Config, NumpyDocstring

    prepared = runpy.run_path(str(ROOT / "docs" / "conf.py"))["prepared"]
    text = "Measured minus simulated: u, v [m/s]."
    of_property, of_class = [text], ground.Fit.__doc__.splitlines()
    prepared(None, "property", "residuals", None, None, of_property)
    assert text in str(NumpyDocstring(of_property, Config(), what="property", name="residuals"))
    prepared(None, "class", "Fit", ground.Fit, None, of_class)
    assert "Examples" in of_class and "Attributes" not in of_class and "model : Model" not in of_class


def test_every_effect_has_its_equation():
    page = (ROOT / "docs" / "theory" / "effects.md").read_text()
    described = set(re.findall(r"^\| `(\w+)` \|", page, re.M))
    known = set(_core.effects())
    folder = ROOT / "cfg" / "craft"
    crafts = [path.read_text() for path in sorted(folder.glob("*.yaml"))]
    fan = (folder / "one_fan_rudder.yaml").read_text()
    crafts.append(re.sub(r"- name: rudder(\n.*){3}", "- {name: rudder, turns: fan, angle: 90}", fan))
    for craft in crafts:
        model = _core.parse_model(craft, "craft.yaml")
        channels = "|".join(one["name"] for one in model.thrusters)
        known |= {re.sub("_(%s)$" % channels, "_NAME", name) for name in _core.effects(model)}
    assert described == known


def test_every_program_is_in_the_reference():
    source = (ROOT / "docs" / "from_code.py").read_text()  # parsed, not imported: sphinx may be missing
    listed = ast.literal_eval(re.search(r"^PROGRAMS = (\[.*\])", source, re.M).group(1))
    listed += ["identify", "track", "tune", "workbench"]
    names = {path.name for path in SCRIPTS.iterdir()}
    assert set(listed) <= names
    launched = "".join(p.read_text() for p in (ROOT / "launch").rglob("*") if p.is_file())
    # All other programs are started by launch files.
    unknown = [name for name in names - set(listed) if not re.search(r"\b%s\b" % name, launched)]
    assert unknown == []


def test_the_effect_of_the_how_to_compiles(tmp_path):
    text = (ROOT / "docs" / "howto" / "effect_cpp.md").read_text()
    (source,) = [body for language, body in FENCE.findall(text) if language == "cpp"]
    file = tmp_path / "effect.cpp"
    file.write_text(source)
    flags = ["-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-Wno-psabi"]
    include = ["-I", str(ROOT / "src" / "ground" / "include"), "-isystem", "/usr/include/eigen3"]
    subprocess.run(["g++", *flags, *include, str(file)], check=True)
