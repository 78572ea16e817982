"""Names, units and notes with markup or control characters, from files of others, do nothing."""

import html.parser
import re

import pytest
import yaml

from browsing import open_page
from conftest import MODEL, process, succeeds, write_bag
from ground.reading import mapping, run_settings
from ground.reports import page
from ground.simulation import gains
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError
from ground.support.progress import harmless

MARKUP = "</script><script>window.ran=1</script>\"'><img src=x onerror=window.ran=2>{{7*7}}"
LINK = '<a href="javascript:window.ran=3">here</a><iframe srcdoc="<script>parent.ran=4</script>">'
FILE = "run '\"><img src=x onerror=window.ran=5><b onmouseover=window.ran=6>"  # of a recording: without /
TRAPS = """return [...document.querySelectorAll("*")].filter(e => ["IFRAME", "OBJECT"].includes(e.tagName)
    || (e.tagName === "IMG" && !e.src.startsWith("data:"))
    || /^javascript:/i.test(e.getAttribute("href") || "")
    || [...e.attributes].some(a => a.name.startsWith("on"))).map(e => e.outerHTML.slice(0, 200))"""


class Elements(html.parser.HTMLParser):
    """What a page has that could run: scripts, and elements that names would make."""

    def __init__(self, text):
        super().__init__()
        self.scripts, self.traps = 0, []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.scripts += tag == "script"
        hostile = tag in ("img", "iframe", "object", "embed", "base") or any(
            name.startswith("on") or "javascript:" in (value or "").lower() for name, value in attributes
        )
        if hostile:
            self.traps.append((tag, attributes))


@pytest.fixture(scope="module")
def hostile_model(tmp_path_factory):
    content = yaml.safe_load(MODEL.read_text())
    content["name"] = MARKUP + LINK
    content["provenance"] = {"date": MARKUP, "command": LINK, "bags": [MARKUP]}
    formula = {
        "name": "odd", "expression": {"X": "c*u"},
        "parameters": {"c": {"value": 0.0, "unit": "<img src=x onerror=window.ran=7>"}},
    }  # fmt: skip
    content["effects"] = [formula]
    path = tmp_path_factory.mktemp("model") / "hostile.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return [write_bag(folder / ("%s%d.bag" % (FILE, s)), start=1000.0 * s, seed=s) for s in (1, 2)]


def page_of(verb, tmp_path, bags, model):
    """The page that a verb writes."""
    arguments = {
        "diagnose": [bags[0], "--holdout", bags[1], "--only", "motor_lag"],
        "compare": [bags[1], "--model", MODEL],
        "history": bags,
    }[verb]
    succeeds(verb, *arguments, "--model", model, "-o", tmp_path / "out")
    return tmp_path / "out" / "report.html"


@pytest.mark.parametrize("verb", ["diagnose", "compare", "history"])
def test_a_page_of_hostile_names_runs_nothing(verb, tmp_path, bags, hostile_model, browser):
    path = page_of(verb, tmp_path, bags, hostile_model)
    found = Elements(path.read_text())
    assert (found.scripts, found.traps) == (3, [])
    open_page(browser, path)
    assert browser.execute_script("return window.ran") is None
    assert browser.execute_script(TRAPS) == []
    text = browser.find_element("tag name", "body").text
    assert "onerror=window.ran" in text, "the name is shown as it is"
    assert "49" not in re.findall(r"onerror=window.ran=2>(.{2})", text), "no template is filled in"


def test_figures_show_markup_as_text(tmp_path, browser):
    line = dict(
        x=[0, 1], y=[0, 1], name=MARKUP + LINK, text=[LINK, MARKUP], hovertemplate=LINK, mode="lines+text"
    )
    axis = {"title": {"text": MARKUP}}
    layout = {
        "height": 300, "xaxis": axis, "yaxis": axis, "meta": {"title": MARKUP, "caption": LINK},
        "annotations": [{"x": 0, "y": 0, "text": LINK}],
    }  # fmt: skip
    path = tmp_path / "figures.html"
    page.write_figures(str(path), [{"data": [line], "layout": layout}])
    assert Elements(path.read_text()).traps == []
    open_page(browser, path)
    browser.execute_script("document.querySelectorAll('a').forEach(e => e.dispatchEvent(new Event('click')))")
    assert browser.execute_script("return window.ran") is None
    assert browser.execute_script(TRAPS) == []


ESCAPES = "\x1b[2J\x1b]0;owned\x07\r\x9b31m\u202e"


def test_control_characters_of_names_are_printed_as_their_codes(tmp_path):
    bag = write_bag(tmp_path / ("run\x1b[31m\r.bag"), duration=4)
    for arguments in ([bag], [tmp_path / "no\x1b[2Jbag"]):
        result = process("identify", "info", *arguments)
        for text in (result.stdout, result.stderr):
            assert not set(text) & set("\x1b\x07\r\x9b\u202e"), repr(text)
        assert "\\x1b[" in result.stdout + result.stderr


def test_text_for_a_terminal_keeps_lines_and_other_alphabets():
    assert harmless("a\tb\nc é µ 漢 →") == "a\tb\nc é µ 漢 →"
    shown = harmless(ESCAPES)
    assert shown.isprintable() and shown.count("\\x1b") == 2 and "\\u202e" in shown


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    "%s: &%s [%s]\n" % (b, b, ", ".join(["*" + a] * 10)) for a, b in zip("abcdefgh", "bcdefghi")
)
MERGES = "a: &a {x: 1}\n" + "".join(
    "%s: &%s {<<: [%s]}\n" % (b, b, ", ".join(["*" + a] * 10)) for a, b in zip("abcdefgh", "bcdefghi")
)


@pytest.mark.parametrize("text", [BOMB, MERGES, "a: &a [*a]", "a: &a {b: *a}", "[" * 500 + "]" * 500])
def test_yaml_that_stands_for_too_much_is_refused(tmp_path, text):
    path = tmp_path / "run.yaml"
    path.write_text("schema: ground/mapping/1\n" + text if text[0] != "[" else text)
    with pytest.raises(GroundError):
        mapping.load(str(path))
    with pytest.raises(GroundError):
        gains.read(str(path))
    warnings = []
    assert list(run_settings.beside(str(tmp_path / "run.bag"), warnings)) == []
    assert len(warnings) == 1
    assert run_settings.RunFile("model.yaml", text).entries() == {"text": text}


def test_ordinary_anchors_are_read():
    assert yaml.load("a: &a [1, 2]\nb: *a\nc: {<<: {x: 3}}", LOADER) == {
        "a": [1, 2],
        "b": [1, 2],
        "c": {"x": 3},
    }


def test_a_result_of_nested_lists_is_no_result(tmp_path):
    from ground.reports import result_folder

    (tmp_path / "history.json").write_text("[" * 100000)
    assert not result_folder.is_of(str(tmp_path / "history.json"), "ground/history/1")
    with pytest.raises(GroundError):
        result_folder.read(tmp_path, "history.json", "ground/history/1")
