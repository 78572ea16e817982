"""The scripts of docs/gallery run as they are shown, and print what is shown."""

import ast
import runpy
import sys

import pytest

from conftest import ROOT, slow

sys.path.insert(0, str(ROOT / "docs"))
import examples

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
