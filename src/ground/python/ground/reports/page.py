"""Pages of text, tables and interactive figures: one file that needs no network.

A page is a template of Jinja, which extends reports/page.html and takes its parts from reports/parts.html.
"""

import base64
import functools
import gzip
import json
import os
import re
from typing import Any, List, Sequence

import jinja2
from markupsafe import Markup, escape

from ground.reports import appearance, words
from ground.support import files, origin
from ground.support.annotations import Plotly

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def write(path: str, template: str, title: str, color: str, force: bool = False, **values: Any) -> None:
    """Writes a page. template: its file, below the package; color: of the verdict; values: what the
    template shows. GroundError when the file exists and `force` is not set."""
    drawn: List[str] = []  # JSON of the figures

    def add(figure: Plotly) -> str:
        """The name of a figure that is drawn."""
        drawn.append(json.dumps(figure, separators=(",", ":"), default=list))
        return "figure%d" % (len(drawn) - 1)

    def figures() -> str:
        return _packed("{%s}" % ",".join('"figure%d":%s' % item for item in enumerate(drawn)))

    loader = jinja2.FileSystemLoader(ROOT)
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters.update(sentence=words.sentence, unbroken=_unbroken)
    environment.globals.update(
        add=add, figures=figures, plotly=_plotly, colors=appearance, origin=origin, folder=os.getcwd(),
        numbers_head=["#" * (i > 1) + name for i, name in enumerate(appearance.NUMBERS)],
    )  # fmt: skip
    text = environment.get_template(template).render(title=title, color=color, **values)
    files.write_text(path, text, force)


def _unbroken(text: object) -> Markup:
    """A text as HTML, whose options such as --all are not broken after a dash."""
    return Markup(re.sub(r"(?<![\w-])--[a-z][a-z-]*", r'<span class="whole">\g<0></span>', str(escape(text))))


def write_figures(path: str, figures: Sequence[Plotly], force: bool = False) -> None:
    """Writes a page of figures only, one below the other. GroundError as from `write`."""
    name = os.path.basename(path)
    write(path, "reports/figures.html", name, appearance.LESS, force, drawn=figures)


@functools.lru_cache(maxsize=None)
def _plotly() -> str:
    from plotly.offline import get_plotlyjs

    return _packed(get_plotlyjs())


def _packed(contents: str) -> str:
    """Compressed text, a quarter of the size. Level 9 takes twice as long for 0.4% less."""
    packed = gzip.compress(contents.encode("utf-8"), compresslevel=7, mtime=0)
    return base64.b64encode(packed).decode("ascii")
