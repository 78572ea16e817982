"""report.html in a browser: plots are drawn, nothing is fetched or cut off, zoom is linked."""

import json
import re
import resource

import pytest

from browsing import assert_fits, assert_sound, open_page
from conftest import MODEL, succeeds, with_effect, write_bag
from ground import cli
from ground.reports import page

TRUTH = "{name: motor_lag, tau: 0.06}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def bags(folder):
    truth = with_effect(folder / "truth.yaml", TRUTH)
    return [write_bag(folder / ("run%d.bag" % s), seed=s, model=truth, nu=(0.3, 0.1, 1)) for s in (1, 40)]


@pytest.fixture(scope="module")
def diagnosed(folder, bags):
    out = folder / "diagnosis"
    only = ["--only", "motor_lag", "input_delay", "floor_tilt"]
    succeeds("diagnose", bags[0], "--holdout", bags[1], "--model", MODEL, "-o", out, *only)
    return out


@pytest.fixture(scope="module")
def compared(folder, bags, diagnosed):
    out = folder / "comparison"
    improved = diagnosed / "improved.yaml"
    result = succeeds("compare", bags[1], "--model", MODEL, "--model", improved, "-o", out)
    assert "improved - it predicts" in result.stdout
    return out


@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_a_disk_that_fills_while_the_page_is_written_keeps_the_numbers(tmp_path, verb, capsys):
    out, bag = tmp_path / "out", write_bag(tmp_path / "run.bag", duration=4)
    arguments = [verb, str(bag), "--model", str(MODEL), "-o", str(out)]
    if verb == "diagnose":
        arguments += ["--only", "motor_lag"]
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1500000, limits[1]))  # less than a page
    try:
        status = cli.main(arguments)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 1
    err = capsys.readouterr().err
    numbers = out / {"compare": "compare.json", "diagnose": "diagnosis.json"}[verb]
    assert json.loads(numbers.read_text())
    last = err.strip().splitlines()[-1]
    assert "the page could not be written" in last and "File too large" in last
    assert str(numbers) in last and "--force" in last
    assert not (out / "report.html").exists()
    if verb == "diagnose":  # the advice of the message works
        assert cli.main(arguments + ["--force"]) == 0
        assert (out / "report.html").exists()


def test_options_in_a_text_are_not_broken_after_a_dash():
    found = page._unbroken("<b> (--all keeps them), a--b, --leave-out RUN")
    assert re.findall(r'<span class="whole">(.*?)</span>', found) == ["--all", "--leave-out"]
    assert found.startswith("&lt;b&gt;")


def test_the_page_of_a_diagnosis(diagnosed, browser):
    names = open_page(browser, diagnosed / "report.html")
    assert len(names) == 1 + 3 * 2  # the fall of the error; three for each of two runs
    assert_sound(browser, names)
    text = browser.find_element("tag name", "body").text
    assert "motor_lag - first-order lag of the thrusters" in text
    for part in ("Evidence", "Data quality", "How it was made", "identify diagnose", "digest", "(held out)"):
        assert part in text, part
    bars, lines = browser.execute_script(
        "const f = document.getElementById('figure0');return [f.data[0].x, f.layout.shapes.map(s => s.x0)]"
    )
    given, refitted, improved = bars
    assert min(given, refitted) > 3 * improved > 0
    assert lines[0] == pytest.approx(improved, rel=0.5)  # noise floor


def test_the_path_shows_the_zoomed_time_span(diagnosed, browser):
    open_page(browser, diagnosed / "report.html")
    shown = (
        "const f = document.getElementById('figure1');"
        "return f.data.filter(t => t.meta === 'path').map(t => t.x.filter(x => x !== null).length)"
    )
    whole = browser.execute_script(shown)
    assert min(whole) > 200
    zoom = (
        "const done = arguments[0], f = document.getElementById('figure1');"
        "Plotly.relayout(f, %s).then(() => setTimeout(done, 200))"
    )
    browser.execute_async_script(zoom % "{'xaxis4.range': [2, 4]}")
    assert browser.execute_script("return document.getElementById('figure1').layout.xaxis.range") == [2, 4]
    part = browser.execute_script(shown)
    assert all(0.1 * w < p < 0.5 * w for w, p in zip(whole, part))
    browser.execute_async_script(zoom % "{'xaxis.range': [0, 100]}")
    assert browser.execute_script(shown) == whole


@pytest.mark.parametrize("verb", ["diagnose", "compare"])
@pytest.mark.parametrize("width", [400, 1200])
def test_nothing_overlaps_or_is_cut_off(diagnosed, compared, browser, as_wide_as, width, verb):
    as_wide_as(width)
    folder = {"diagnose": diagnosed, "compare": compared}[verb]
    open_page(browser, folder / "report.html")
    assert_fits(browser, width)
