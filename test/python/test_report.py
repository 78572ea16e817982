"""report.html in a browser: plots are drawn, nothing is fetched, zoom is linked, and it can be printed."""
import base64
import io
import json
import re
import resource
import shutil
import subprocess

import pytest
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


@pytest.fixture(scope="module")
def browser():
    webdriver = pytest.importorskip("selenium.webdriver")
    service = pytest.importorskip("selenium.webdriver.chrome.service")
    if not shutil.which("chromedriver"):
        pytest.skip("chromedriver is not installed")
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--window-size=1280,900"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(
        service=service.Service(shutil.which("chromedriver")), options=options
    )
    yield driver
    driver.quit()


DRAWN = """
return [...document.querySelectorAll(".figure")].filter(f => !f.closest("details:not([open])"))
    .map(f => [f.id, f.dataset.drawn])"""


def waiting(browser, seconds):
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, seconds)


def wait_until_drawn(browser):
    waiting(browser, 60).until(
        lambda b: all(state == "yes" for _, state in b.execute_script(DRAWN))
    )
    return browser.execute_script(DRAWN)


def open_page(browser, path):
    """Opens a page and all its runs; returns the names of its figures."""
    browser.get(path.resolve().as_uri())
    wait_until_drawn(browser)
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    return [name for name, _ in wait_until_drawn(browser)]


def assert_sound(browser, names):
    """Checks for errors, fetched resources, empty plots, and content wider than the window."""
    from PIL import Image

    assert [line for line in browser.get_log("browser") if line["level"] != "INFO"] == []
    fetched = "return performance.getEntriesByType('resource').map(e => e.name)"
    assert [n for n in browser.execute_script(fetched) if not n.startswith("data:")] == []
    width, window = browser.execute_script(
        "return [document.documentElement.scrollWidth, window.innerWidth]"
    )
    assert width <= window
    for name in names:
        element = browser.find_element("id", name)
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
        picture = Image.open(io.BytesIO(element.screenshot_as_png)).convert("L")
        inked = sum(picture.histogram()[:200]) / (picture.width * picture.height)
        assert inked > 0.004, "%s is empty" % name


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


# Texts of figures that overlap by more than 2 pixels, as the rotated rectangles that they are, or that
# reach beyond their figure.
CROWDED = """
const found = [], corners = text => {
  const b = text.getBBox(), m = text.getScreenCTM();
  return [[0, 0], [1, 0], [1, 1], [0, 1]].map(([i, j]) => [b.x + i * b.width, b.y + j * b.height])
    .map(([x, y]) => [m.a * x + m.c * y + m.e, m.b * x + m.d * y + m.f]);
};
const depth = (one, other) => Math.min(...[one, other].flatMap(sides => [0, 1].map(i => {
  const [x, y] = [0, 1].map(k => sides[i + 1][k] - sides[i][k]), length = Math.hypot(x, y) || 1;
  const [a, b] = [one, other].map(s => s.map(p => (p[0] * x + p[1] * y) / length));
  return Math.min(Math.max(...a), Math.max(...b)) - Math.max(Math.min(...a), Math.min(...b));
})));
for (const figure of document.querySelectorAll(".figure[data-drawn]")) {
  const texts = [...figure.querySelectorAll("text")].filter(t => t.textContent.trim() &&
    !t.closest(".modebar") && t.getBoundingClientRect().width && getComputedStyle(t).visibility != "hidden");
  const places = texts.map(corners), frame = figure.getBoundingClientRect();
  texts.forEach((text, i) => {
    const box = text.getBoundingClientRect();
    if (box.left < frame.left - 1 || box.right > frame.right + 1 || box.top < frame.top - 1 ||
        box.bottom > frame.bottom + 1) found.push(figure.id + " cuts off " + text.textContent);
    for (let j = 0; j < i; j++)
      if (depth(places[i], places[j]) > 2)
        found.push(figure.id + ": " + text.textContent + " | " + texts[j].textContent);
  });
}
return found"""


@pytest.fixture
def as_wide_as(browser):
    """A function that makes the browser's window as wide as a device [pixels]."""

    def resize(width):
        device = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", device)

    yield resize
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def shape(browser):
    """Forms of the figures that are drawn, after they have been drawn for a new width."""
    wait_until_drawn(browser)
    forms = "return [...document.querySelectorAll('.figure[data-drawn]')].map(f => f.dataset.form)"
    return set(browser.execute_script(forms))


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
    from ground.recordings import quality, recording
    from ground.reports import inspection, page, report

    model = _core.load_model(str(MODEL))
    run = quality.Run(recording.read_bag(str(bags[0]))).data(model)
    studies = [inspection.inspect(run, model, "a"), inspection.inspect(run, model, "b")]

    def size(runs):
        sheet, path = page.Page("many"), folder / ("%d.html" % runs)
        report._measured_against(sheet, [studies] * runs, [{"begins": 1.0}] * runs, "b")
        sheet.write(str(path), "#000")
        return path.stat().st_size

    one, three = size(1), size(3)
    assert one + 19 * (three - one) / 2 < 10e6
