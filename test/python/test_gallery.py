"""The scripts of docs/gallery run as they are shown, and print what is shown."""

import ast
import subprocess
import sys

import pytest

from conftest import ROOT, slow

sys.path.insert(0, str(ROOT / "docs"))
import examples

GALLERY = ROOT / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*.py"))
LONGEST = 15  # lines
SLOW = {"watch_discovery"}  # takes over 20 s


def imported(script):
    """Packages that a script needs."""
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module.split(".")[0]


@pytest.mark.parametrize(
    "script",
    [pytest.param(one, marks=[slow] * (one.stem in SLOW), id=one.stem) for one in SCRIPTS],
)
def test_a_script_prints_what_the_page_shows(script, tmp_path):
    for package in set(imported(script)) - {"ground"}:
        pytest.importorskip(package)
    (tmp_path / "cfg").symlink_to(ROOT / "cfg")
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=str(tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stderr
    shown = script.with_suffix(".txt").read_text().splitlines()
    assert examples.differences(examples.Shown(0, 0, shown, done.stdout.splitlines())) == []


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_is_short_documented_and_shown(script):
    text = script.read_text()
    assert len(text.splitlines()) <= LONGEST
    assert ast.get_docstring(ast.parse(text))
    page = (ROOT / "docs" / "howto" / "gallery.md").read_text()
    assert "gallery/%s.py" % script.stem in page and "gallery/%s.txt" % script.stem in page


def test_the_notebook_is_on_the_page():
    assert len(SCRIPTS) >= 8
    page = (ROOT / "docs" / "howto" / "gallery.md").read_text()
    assert "notebooks/demo.ipynb" in page  # test_api.py runs it
