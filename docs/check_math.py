#!/usr/bin/python3
"""check_math.py HTML_FOLDER: lists formulas that KaTeX cannot draw in a browser; status 1 if any."""

import pathlib
import sys

from selenium import webdriver

# KaTeX draws what it does not know in red; asked once more, it throws.
CANNOT = """
  if (typeof katex === "undefined") return ["anything: it is not there"];
  const draws = element => {
    const tex = element.querySelector("annotation");
    if (!tex) return false;
    const display = { displayMode: element.tagName === "DIV" };
    try { katex.renderToString(tex.textContent, display); return true; } catch (error) { return false; }
  };
  return [...document.querySelectorAll(".math")].filter(e => !draws(e)).map(
    e => (e.querySelector("annotation") || e).textContent);
"""


def main(folder):
    options = webdriver.ChromeOptions()
    for option in ("--headless", "--no-sandbox", "--disable-dev-shm-usage"):
        options.add_argument(option)
    browser = webdriver.Chrome(options=options)
    pages, bad = 0, 0
    try:
        for page in sorted(pathlib.Path(folder).resolve().rglob("*.html")):
            if 'class="math' in page.read_text():
                browser.get(page.as_uri())
                pages += 1
                for formula in browser.execute_script(CANNOT):
                    bad += 1
                    print("%s: KaTeX cannot draw %s" % (page, formula), file=sys.stderr)
    finally:
        browser.quit()
    if not pages:
        print("%s: no page has a formula" % folder, file=sys.stderr)
    return 1 if bad or not pages else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
