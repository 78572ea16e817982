"""What pages of the documentation say that their commands print is what they print; blocks of Python run."""

import ast
import importlib.util
import runpy
import sys

import plotly.basedatatypes
import pytest

from conftest import ROOT, slow

sys.path.insert(0, str(ROOT / "docs"))
import examples

TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
# Pages whose commands are not run, and why. test_docs.py checks that programs and launch files take them.
NOT_RUN = {
    "README.md": "the demo and a launch with rviz; the tutorial has the verbs",
    "CONTRIBUTING.md": "builds and tests this workspace",
    "docs/bench.md": "needs a craft on a scale",
    "docs/experiment.md": "needs a room with a craft; rostests fly a simulated one",
    "docs/second_craft.md": "names recordings of others; test_four_thrusters.py fits and diagnoses them",
    "docs/simulation.md": "launch files, some with rviz; rostests fly them",
    "docs/tracking.md": "takes minutes and a running master; test_track.py and test_tune.py do so in short",
    "docs/watching.md": "needs a running launch file or a display; rostests watch",
    "docs/howto/viewer.md": "needs a running launch file and a viewer; test_viewer.py serves one",
    "docs/howto/controller_cpp.md": "builds another workspace, as test_downstream.py does",
    "docs/howto/controller_python.md": "controller_python.test flies the node that the page shows",
    "docs/howto/discover.md": "takes many minutes; discover.test does so in short",
    "docs/howto/effect_cpp.md": "its effect has to be built first; test_docs.py compiles it",
    "docs/howto/file_format.md": "names recordings of a reader; test_mapping.py drafts mappings",
    "docs/howto/index.md": "sets variables for the pages below it",
    "docs/howto/plot.md": "the test of its blocks of Python runs it",
    "docs/howto/workbench.md": "serves until Ctrl-C; test_workbench.py does what the page says",
    "docs/howto/without_ros.md": "installs packages; test_wheel.py does so in an environment of its own",
}
RECORDED = """
import ground, os
model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
model.save("craft.yaml")
os.mkdir("bags")
run = ground.simulate(model.with_effect("motor_lag", tau=0.05), "prbs", duration=8, seed=2, name="run1")
run.save("run.bag")
run.save("bags/run1.bag")
fit = ground.fit(model, run)
"""
COMPARED = """
fit.save("fitted.yaml")
comparison = ground.compare({"given": model, "fitted": "fitted.yaml"}, run)
"""
LOGGED = """
import numpy
frame = run.to_frame(raw=True).dropna()
frame["y"], frame["psi"] = -frame.y, -numpy.degrees(frame.psi)
frame.to_csv("run.log", sep=" ", header=False, index=False)
"""
WRITTEN = 'model.export("craft.py")\nmodel.export("craft_casadi.py", to="casadi")\n'
# What a reader of a page has before the first block of Python on it
# The page's first block as the module that its second one imports
HOLD_POINT = """
import re, sys, types
module = sys.modules["hold_point"] = types.ModuleType("hold_point")
exec(re.search("```python\\n(.*?)```", open(%r).read(), re.S).group(1), vars(module))
"""
BEFORE = {
    "docs/howto/controller_python.md": HOLD_POINT % str(examples.DOCS / "howto" / "controller_python.md"),
    "docs/howto/file_format.md": RECORDED + LOGGED,
    "docs/howto/own_controller.md": RECORDED + WRITTEN,
    "docs/howto/plot.md": RECORDED + COMPARED + 'comparison.save("compare")\n',
    "docs/howto/python.md": RECORDED,
    "docs/howto/results.md": RECORDED + COMPARED,
}


@pytest.mark.parametrize(  # the tutorial runs without SLOW=1, too
    "session",
    [pytest.param(s, marks=[slow] * (s is not examples.SESSIONS[0]), id=s[0]) for s in examples.SESSIONS],
)
def test_pages_show_what_their_commands_print(session):
    assert examples.checked_session([examples.DOCS / name for name in session]) == []


def name_of(page):
    return str(page.relative_to(ROOT))


def blocks_of(page, *languages):
    """The blocks of a page that run: start in the page, and text."""
    found = examples.BLOCK.finditer(page.read_text())
    return [(b.start(3), b.group(3)) for b in found if b.group(2) in languages and not b.group(1)]


def missing_modules(code):
    """Packages that a block imports and that are not installed."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if importlib.util.find_spec(alias.name.split(".")[0]) is None:
                    yield alias.name


@pytest.mark.parametrize("page", [p for p in TEXTS if blocks_of(p, "py", "python")], ids=name_of)
def test_the_blocks_of_python_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(sys, "argv", ["missing.py", "compare/run1.wrench.fitted.csv", "missing.png"])
    monkeypatch.setattr(plotly.basedatatypes.BaseFigure, "show", lambda figure: figure.to_json())
    if importlib.util.find_spec("xarray") is None:
        monkeypatch.setattr("ground.reading.recording.Recording.to_xarray", lambda run: None)
    (tmp_path / "cfg").symlink_to(ROOT / "cfg")
    names, missing = {}, []
    exec(compile(BEFORE.get(name_of(page), ""), "before the blocks", "exec"), names)
    for start, code in blocks_of(page, "py", "python"):
        line = page.read_text()[:start].count("\n")
        missing += missing_modules(code)
        if not missing:
            exec(compile("\n" * line + code, name_of(page), "exec"), names)
    if missing:
        pytest.skip("not installed: %s" % ", ".join(missing))


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_every_block_of_commands_runs_or_says_why_not(page):
    is_run = page in [examples.DOCS / name for name in examples.PAGES]
    assert bool(blocks_of(page, "sh")) == (is_run or name_of(page) in NOT_RUN)


# --- the scripts of the gallery

GALLERY = ROOT / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
SLOW = {"watch_discovery"}  # takes over 20 s


def imported(script):
    """Packages that a script needs."""
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module.split(".")[0]


@pytest.mark.parametrize(
    "script", [pytest.param(one, marks=[slow] * (one.stem in SLOW), id=one.stem) for one in SCRIPTS]
)
def test_a_script_prints_what_the_page_shows(script, tmp_path, monkeypatch, capsys):
    """In this process, because a new one takes seconds to load its libraries."""
    for package in set(imported(script)) - {"ground"}:
        pytest.importorskip(package)
    (tmp_path / "cfg").symlink_to(ROOT / "cfg")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))  # a script imports what it has exported
    runpy.run_path(str(script), run_name="__main__")
    shown, printed = script.with_suffix(".txt").read_text(), capsys.readouterr().out
    assert examples.differences(examples.Shown(0, 0, shown.splitlines(), printed.splitlines())) == []


def test_every_script_is_on_the_page():
    page = (ROOT / "docs" / "howto" / "gallery.md").read_text()
    for script in SCRIPTS:
        assert "gallery/%s.py" % script.stem in page and "gallery/%s.txt" % script.stem in page
