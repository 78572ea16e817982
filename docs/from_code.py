"""A directive that generates parts of the reference from the code when the pages are built.

    ```{from-code} verbs
    ```

A generator is a function in the table GENERATORS that returns lines of Markdown. One that needs the
built package (make build) fails with one line if the package is missing.
"""

import contextlib
import io
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from unittest import mock

from docutils.nodes import section
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.errors import ExtensionError

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PACKAGE = os.path.join(ROOT, "src", "ground")
MESSAGES = os.path.join(ROOT, "src", "ground_msgs")
# Programs beside identify, track, tune and workbench
PROGRAMS = ["demo", "record", "view", "viewer", "plot", "parameters", "prove_stop"]


def core():
    try:
        from ground import _core
    except ImportError as error:
        raise ExtensionError("the reference needs the built package (make build): %s" % error)
    return _core


def read(*parts):
    with open(os.path.join(*parts), encoding="utf-8") as file:
        return file.read()


def code(text, language="text"):
    return ["```" + language, *text.rstrip().splitlines(), "```", ""]


def table(heads, rows):
    """A Markdown table; cells are plain text."""

    def cells(row):
        return "| " + " | ".join(str(c).replace("|", "\\|") for c in row) + " |"

    return [cells(heads), cells(["---"] * len(heads)), *map(cells, rows), ""]


def plain(text):
    """Text of a comment, in which only `code` is Markdown."""
    return re.sub(r"([<>*_\[\]~])(?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\\\1", text)


# --- verbs


def help_of(program, *arguments):
    """Output of --help of a program, run in a separate process."""
    script = os.path.join(PACKAGE, "scripts", program)
    return subprocess.run(
        [sys.executable, script, *arguments, "--help"],
        check=True,
        stdout=subprocess.PIPE,
        universal_newlines=True,
        env=dict(os.environ, COLUMNS="100", HOME="~", ROS_HOME="~/.ros"),
    ).stdout


def in_process(run):
    """Output of --help of a command line, run in this process."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), mock.patch.dict(os.environ, COLUMNS="100"):
        with contextlib.suppress(SystemExit):
            run(["--help"])
    return out.getvalue()


def verbs():
    core()
    from ground import cli

    for verb in cli.VERBS:
        yield from ["## identify %s" % verb.name, ""]
        yield from code(in_process(lambda argv, verb=verb: cli.main([verb.name] + argv)))
    for name in sorted(set(cli.PROGRAMS) - {verb.name for verb in cli.VERBS}):
        yield from ["## %s" % name, ""]
        yield from code(in_process(lambda argv, name=name: cli.program(name, argv)))
    for name in PROGRAMS:
        yield from ["## %s" % name, "", *code(help_of(name))]


# --- nodes and their live parameters


def class_comment(name, path):
    """The /// comment above a class, as paragraphs; empty when there is none."""
    found = re.search(r"((?:^///.*\n)+)(?:template.*\n)?class %s\b" % name, read(path), re.M)
    lines = found.group(1).splitlines() if found else []
    return "\n".join(line[3:].strip() for line in lines)


def live_parameters(name):
    """(group, parameters) of cfg/NAME.cfg, as the generator of dynamic_reconfigure has them."""
    from dynamic_reconfigure import parameter_generator_catkin as catkin

    kept = []

    def generate(generator, *_):
        kept.extend((group.name, group.parameters) for group in generator.group.groups)
        return 0

    path = os.path.join(ROOT, "cfg", name + ".cfg")
    with mock.patch.object(catkin.ParameterGenerator, "generate", generate):
        with contextlib.suppress(SystemExit):
            runpy.run_path(path)
    return kept


def number(value):
    return value if isinstance(value, (str, bool)) else "%g" % value


def parameter_table(name):
    rows = []
    for _, parameters in live_parameters(name):
        for p in parameters:
            text = isinstance(p["default"], (str, bool))
            between = "" if text else "%g to %g" % (p["min"], p["max"])
            default = "`%s`" % number(p["default"]) if p["default"] != "" else "empty"
            rows.append(["`%s`" % p["name"], default, between, plain(p["description"])])
    return table(["live parameter", "default", "range", "what [unit]"], rows)


def nodes():
    include = os.path.join(PACKAGE, "include", "ground", "nodelets")
    for title, name, file in (
        ("All controllers", "Controller", "controller.h"),
        ("All controllers that follow a reference", "ReferenceTracking", "reference_tracking.h"),
    ):
        comment = plain(class_comment(name, os.path.join(include, file)))
        yield from ["## " + title, "", *comment.splitlines(), ""]
    library = ElementTree.parse(os.path.join(PACKAGE, "nodelet_plugins.xml")).getroot()
    for element in library.iter("class"):
        name = element.get("name").partition("/")[2]
        source = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
        comment = class_comment(name, os.path.join(PACKAGE, "src", "nodelets", source + ".cpp"))
        text = comment or element.findtext("description").strip()
        yield from ["## " + name, "", *plain(text).splitlines(), "", *parameter_table(name)]


def launch_files():
    folder = os.path.join(ROOT, "launch")
    for file in sorted(f for f in os.listdir(folder) if f.endswith(".launch")):
        root = ElementTree.parse(os.path.join(folder, file)).getroot()
        rows = []
        for arg in root.findall("arg"):
            default = arg.get("default")
            if arg.get("value") is None:
                shown = "required" if default is None else "`%s`" % default
                rows.append(["`%s`" % arg.get("name"), shown, plain(arg.get("doc", ""))])
        yield from ["## " + file, "", *table(["argument", "default", "what"], rows)]


# --- messages, effects, designs


def messages():
    for folder, ending, title in (("msg", ".msg", "Messages"), ("srv", ".srv", "Services")):
        yield from ["## " + title, ""]
        path = os.path.join(MESSAGES, folder)
        for file in sorted(os.listdir(path)):
            yield from ["### " + file[: -len(ending)], "", *code(read(path, file))]


def effects():
    rows = []
    for name, info in core().effects().items():
        listed = info["parameters"]
        if len(listed) > 4:
            listed = [dict(listed[0], name="%s … %s" % (listed[0]["name"], listed[-1]["name"]))]
        for p in listed:
            between = "%g to %g" % (p["lower"], p["upper"])
            row = ["`%s`" % name, plain(info["summary"])] if p is listed[0] else ["", ""]
            row += ["`%s`" % p["name"], p["unit"], plain(p["doc"]), "%g" % p["neutral"], between]
            rows.append(row)
    heads = ["effect", "what", "parameter", "unit", "meaning", "neutral", "range"]
    return table(heads, rows)


def designs():
    rows = [[("`%s`" % d.name), plain(d.text), ", ".join(d.takes)] for d in core().design_table()]
    return table(["design", "what is played", "takes"], rows)


def channels():
    core()
    from ground.exporting import channels as c

    rows = [
        [topic, kind.about, ", ".join((*kind.numbers, *kind.texts, *kind.flags))]
        for topic, kind in c.KINDS.items()
        if not topic.startswith("/model2")
    ]
    rows += [[topic, about, "the names of the channels, 0..1"] for topic, about in c.COMMANDS.items()]
    rows.append([c.BELIEFS, c.ABOUT_BELIEFS, "beliefs: effect, probability, state"])
    rows += [[topic, about, "a schema of Foxglove"] for topic, about in c.SCENES.items()]
    return table(
        ["channel", "what", "fields"], [["`%s`" % topic, *map(plain, rest)] for topic, *rest in rows]
    )


def requirements():
    return runpy.run_path(os.path.join(ROOT, "test", "requirements.py"))


def faults():
    """Every fault with how it ends, and the worst case that the fault benches have measured last."""
    functions = requirements()
    measured = functions["measured"]()
    rows = []
    for fault in functions["load"]()["fault"]:
        worst = dict.fromkeys(measured["faults"][name]["worst"] for name in fault["measured"])
        said = "; ".join(text.strip(": ") for text in worst if text != "no stop")
        rows.append(
            [*map(plain, (fault["name"], fault["ends"], said)), ", ".join(map(str, fault["promises"]))]
        )
    return table(["fault", "ends", "worst of %d" % measured["rounds"], "promises"], rows)


def promises():
    """Every promise with its limit and the test that fails without its rule."""
    functions = requirements()
    rows = [
        [promise["number"], plain(functions["sentence"](promise)), "`%s`, `%s`" % tuple(promise["test"])]
        for promise in functions["load"]()["promise"]
    ]
    return table(["promise", "what", "test"], rows)


GENERATORS = {
    "verbs": verbs,
    "nodes": nodes,
    "launch": launch_files,
    "messages": messages,
    "channels": channels,
    "effects": effects,
    "designs": designs,
    "faults": faults,
    "promises": promises,
}


class FromCode(Directive):
    required_arguments = 1

    def run(self):
        name = self.arguments[0]
        if name not in GENERATORS:
            raise self.error("from-code knows %s, not %s" % (", ".join(GENERATORS), name))
        parent = section()
        lines = StringList(list(GENERATORS[name]()), "from_code")
        self.state.nested_parse(lines, self.content_offset, parent, True)
        return parent.children


def setup(app):
    app.add_directive("from-code", FromCode)
    return {"version": "1", "parallel_read_safe": True}
