"""Pages in a browser: fixtures `browser` and `as_wide_as` are in conftest.py."""

import io

DRAWN = """
return [...document.querySelectorAll(".figure")].filter(f => !f.closest("details:not([open])"))
    .map(f => [f.id, f.dataset.drawn])"""


def waiting(browser, seconds):
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, seconds)


def wait_until_drawn(browser):
    waiting(browser, 60).until(lambda b: all(state == "yes" for _, state in b.execute_script(DRAWN)))
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
    width, window = browser.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
    assert width <= window
    for name in names:
        element = browser.find_element("id", name)
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
        picture = Image.open(io.BytesIO(element.screenshot_as_png)).convert("L")
        inked = sum(picture.histogram()[:200]) / (picture.width * picture.height)
        assert inked > 0.004, "%s is empty" % name


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


def assert_fits(browser, width):
    """Checks that the page is no wider than its window, that texts of figures do not overlap, and, on a
    screen that is not a telephone's, that nothing has to be scrolled sideways."""
    page = "return document.documentElement.scrollWidth"
    assert browser.execute_script(page) <= width
    assert browser.execute_script(CROWDED) == []
    cut = "return [...document.querySelectorAll('.wide')].filter(e => e.scrollWidth > e.clientWidth).length"
    assert width < 1000 or browser.execute_script(cut) == 0
