"""Files of figures: a page, or a picture of it that a browser without a window takes."""

import os
import shutil
import subprocess
import tempfile
from typing import Sequence

from ground.reports import appearance, page
from ground.support import files
from ground.support.annotations import Document
from ground.support.errors import GroundError

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
WIDTH, AROUND = 1120, 120  # width of a picture; height around a figure [pixels]
DRAWING = 20000  # time for a page to be drawn, of the browser's clock [ms]; it ends when all is done


def write(path: str, figures: Sequence[Document], force: bool = False) -> None:
    """Writes figures one below the other: a page if the path ends with .html, else a PNG.

    force: overwrite. GroundError when the file cannot be written, or no browser can draw the PNG.
    """
    if path.endswith(".html"):
        _write_page(path, figures, force)
        return
    browser = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if browser is None:
        raise GroundError(
            "%s: a PNG needs Chromium, which is not installed; name a file that ends with .html, whose "
            "figures any browser shows and saves" % path
        )
    height = sum(figure["layout"]["height"] + AROUND for figure in figures)
    with tempfile.TemporaryDirectory() as folder, files.new_file(path, force) as temporary:
        source, drawn = os.path.join(folder, "page.html"), os.path.join(folder, "page.png")
        _write_page(source, figures)
        command = [browser, "--headless", "--disable-gpu", "--hide-scrollbars"]
        command += ["--user-data-dir=" + folder, "--window-size=%d,%d" % (WIDTH, height)]
        command += ["--virtual-time-budget=%d" % DRAWING, "--screenshot=" + drawn]
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium refuses root with its sandbox
        done = subprocess.run(
            [*command, "file://" + source],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
        )
        if not os.path.exists(drawn):
            raise GroundError("%s: %s could not draw it: %s" % (path, browser, done.stdout[-500:]))
        shutil.move(drawn, temporary)


def _write_page(path: str, figures: Sequence[Document], force: bool = False) -> None:
    name = os.path.basename(path)
    page.write(path, "reports/figures.html", name, appearance.LESS, force, drawn=figures)
