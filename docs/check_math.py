#!/usr/bin/python3
"""check_math.py HTML_FOLDER: says which formulas KaTeX cannot draw, by a browser; 1 if there are any."""
import pathlib
import sys

from selenium import webdriver

CANNOT = """
  if (typeof katex === "undefined") return ["katex is not there"];
  return [...document.querySelectorAll(".math")].filter(
    e => e.querySelector(".katex-error") || !e.querySelector(".katex")).map(e => e.textContent)
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
