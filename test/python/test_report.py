"""report.html in a browser: plots are drawn, nothing is fetched, zoom is linked, and it can be printed."""
import base64
import json
import re
import resource
import shutil
import subprocess

import pytest
from browsing import CROWDED, assert_sound, open_page, shape, wait_until_drawn, waiting
from conftest import MODEL, identify, write_bag
from test_diagnose import with_effect

from ground import cli

TRUTH = "{name: motor_lag, tau: 0.06}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def bags(folder):
    truth = with_effect(folder / "truth.yaml", TRUTH)
    return [
        write_bag(folder / ("run%d.bag" % s), seed=s, model=truth, nu=(0.3, 0.1, 1))
        for s in (1, 40)
    ]


@pytest.fixture(scope="module")
def diagnosed(folder, bags):
    out = folder / "diagnosis"
    only = ["--only", "motor_lag", "input_delay", "floor_tilt"]
    result = identify("diagnose", bags[0], "--holdout", bags[1], "--model", MODEL, "-o", out, *only)
    assert result.returncode == 0, result.stderr
    return out


@pytest.fixture(scope="module")
def compared(folder, bags, diagnosed):
    out = folder / "comparison"
    improved = diagnosed / "improved.yaml"
    result = identify("compare", bags[1], "--model", MODEL, "--model", improved, "-o", out)
    assert result.returncode == 0, result.stderr
    assert "improved predicts best" in result.stdout
    return out


@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_a_disk_that_fills_while_the_page_is_written_keeps_the_numbers(
    tmp_path, verb, capsys, monkeypatch
):
    monkeypatch.setattr("ground.reports.comparison_files._draw", lambda *_: None)  # slow
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


def test_the_page_of_a_diagnosis(diagnosed, browser):
    names = open_page(browser, diagnosed / "report.html")
    assert len(names) == 2 + 5 * 2  # fall, shares; five for each of two runs
    assert_sound(browser, names)
    text = browser.find_element("tag name", "body").text
    assert "First-order lag of the thrusters (motor_lag) is missing" in text
    for part in (
        "Evidence",
        "Data quality",
        "How it was made",
        "identify diagnose",
        "SHA-256",
        "Ceres",
        "input_delay",
        "seeds",
        "recorded",
        "of a simulated clock; error: nominal",
        "(held out)",
    ):
        assert part in text, part
    bars, lines = browser.execute_script(
        "const f = document.getElementById('figure0');"
        "return [f.data[0].x, f.layout.shapes.map(s => s.x0)]"
    )
    assert len(bars) == 2 and bars[0] > 3 * bars[1] > 0
    assert lines[0] == pytest.approx(bars[1], rel=0.5)  # the noise floor


def test_the_best_effect_is_drawn_over_the_missing_wrench(diagnosed, browser):
    open_page(browser, diagnosed / "report.html")
    missing, predicted = browser.execute_script(
        "const traces = document.getElementById('figure4').data;"
        "const pick = name => traces.filter(t => t.name.startsWith(name)).map(t => t.y);"
        "return [pick('nominal'), pick('added by')]"
    )

    assert len(missing) == len(predicted) == 3 * 10
    # Yaw moment over the difference of the thrusters: row 3, column 4.
    at = 2 * 10 + 3
    assert max(missing[at]) > 0.2  # mN m
    assert predicted[at] == pytest.approx(missing[at], abs=0.15 * max(map(abs, missing[at])))


def test_the_path_shows_the_zoomed_time_span(diagnosed, browser):
    open_page(browser, diagnosed / "report.html")
    shown = (
        "const f = document.getElementById('figure2');"
        "return f.data.filter(t => t.meta === 'path').map(t => t.x.filter(x => x !== null).length)"
    )
    whole = browser.execute_script(shown)
    assert min(whole) > 200
    zoom = (
        "const done = arguments[0], f = document.getElementById('figure2');"
        "Plotly.relayout(f, %s).then(() => setTimeout(done, 200))"
    )
    browser.execute_async_script(zoom % "{'xaxis4.range': [2, 4]}")
    assert browser.execute_script(
        "return document.getElementById('figure2').layout.xaxis.range"
    ) == [2, 4]
    part = browser.execute_script(shown)
    assert all(0.1 * w < p < 0.5 * w for w, p in zip(whole, part))
    browser.execute_async_script(zoom % "{'xaxis.range': [0, 100]}")
    assert browser.execute_script(shown) == whole


@pytest.mark.parametrize("verb", ["diagnose", "compare"])
@pytest.mark.parametrize("width", [400, 768, 1280])
def test_nothing_overlaps_or_is_cut_off(diagnosed, compared, browser, as_wide_as, width, verb):
    as_wide_as(width)
    folder = {"diagnose": diagnosed, "compare": compared}[verb]
    open_page(browser, folder / "report.html")
    assert shape(browser) == {"narrow" if width == 400 else "wide"}
    wide, window = browser.execute_script(
        "return [document.documentElement.scrollWidth, window.innerWidth]"
    )
    assert window == width and wide <= width
    assert browser.execute_script(CROWDED) == []


def test_figures_follow_a_telephone_that_is_turned(compared, browser, as_wide_as):
    as_wide_as(400)
    open_page(browser, compared / "report.html")
    tall = browser.execute_script("return document.getElementById('figure2').clientHeight")
    as_wide_as(900)
    waiting(browser, 20).until(lambda b: shape(b) == {"wide"})
    wide = browser.execute_script("return document.getElementById('figure2').clientHeight")
    assert tall > 1.3 * wide and browser.execute_script(CROWDED) == []


def printed(browser, folder):
    """Texts of the pages of the page's PDF, of the first run that it has."""
    path = folder / "printed.pdf"
    path.write_bytes(base64.b64decode(browser.print_page()))
    text = subprocess.check_output(["pdftotext", "-layout", str(path), "-"], universal_newlines=True)
    return [page.split("\n") for page in text.split("\f")[:-1]]


@pytest.mark.skipif(not shutil.which("pdftotext"), reason="pdftotext (poppler-utils) is missing")
def test_paper_is_compact_without_stranded_headings(diagnosed, browser, folder):
    browser.get((diagnosed / "report.html").resolve().as_uri())
    wait_until_drawn(browser)
    pages = printed(browser, folder)
    assert len(pages) <= 6  # eight before figures were made for paper
    headings = browser.execute_script(
        "return [...document.querySelectorAll('h1, h2, h3, .paper, th')].map(h => h.textContent)"
    )
    headings = {re.sub(r"\s+", " ", heading).strip() for heading in headings}
    assert {"Evidence", "Data quality", "Where it fails"} <= headings
    for page in pages:
        last = [re.sub(r"\s+", " ", line).strip() for line in page if line.strip()][-1]
        assert last not in headings, "stranded: " + last
    assert any("from 1000" in line for page in pages for line in page)  # the run's heading


def test_figures_fit_on_paper(diagnosed, browser):
    names = open_page(browser, diagnosed / "report.html")
    browser.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert shape(browser) == {"paper"}
    widths = browser.execute_script(
        "return [...document.querySelectorAll('.figure .main-svg')].map(s => s.clientWidth)"
    )
    assert len(widths) >= len(names) and max(widths) <= 700
    assert browser.execute_script(CROWDED) == []
    browser.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert shape(browser) == {"wide"}


def test_the_page_of_a_comparison(compared, browser):
    names = open_page(browser, compared / "report.html")
    assert len(names) == 7
    assert_sound(browser, names)
    text = browser.find_element("tag name", "body").text
    assert "improved predicts best" in text and "prediction error" in text


def test_a_page_of_twenty_runs_stays_below_10_mb(folder, bags):
    from ground import _core
    from ground.recordings import quality, readers
    from ground.reports import inspection, page, report

    model = _core.load_model(str(MODEL))
    run = quality.repaired(readers.read(str(bags[0]))).data(model)
    studies = [inspection.inspect(run, model, "a"), inspection.inspect(run, model, "b")]

    def size(runs):
        sheet, path = page.Page("many"), folder / ("%d.html" % runs)
        report._measured_against(sheet, [studies] * runs, [{"begins": 1.0}] * runs, "b")
        sheet.write(str(path), "#000")
        return path.stat().st_size

    one, three = size(1), size(3)
    assert one + 19 * (three - one) / 2 < 10e6
