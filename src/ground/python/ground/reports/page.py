"""Pages of text, tables and interactive figures: one file that needs no network."""

import base64
import functools
import gzip
import html
import json
import string
from typing import Dict, Iterable, List, Sequence

from ground import files
from ground.annotations import Document
from ground.reports import appearance

PAGE = string.Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<link rel="icon" href="data:,">
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 16px/1.5 system-ui, sans-serif; color: $text; max-width: 68rem; margin: 2rem auto;
  padding: 0 1rem; overflow-wrap: anywhere }
h1 { font-size: 1.4rem } h2 { font-size: 1.15rem; margin-top: 2.2rem }
h3 { font-size: 1rem; margin: 1.2rem 0 .2rem }
.verdict { font-size: 1.25rem; border-left: .4rem solid $color; padding: .5rem 1rem; background: #f6f6f4 }
.plot { margin: 0 } .figure { overflow: hidden } .panels .figure { min-width: 50rem }
.caption { font-size: .85rem; color: $less; margin: .1rem 0 .6rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: .85rem; width: 100% }
th, td { text-align: left; padding: .25rem .6rem; border-bottom: 1px solid $lines; vertical-align: top;
  overflow-wrap: normal; min-width: 3rem }
td.n, th.n { width: 1%; text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums }
td.whole { white-space: nowrap }
tr.chosen { background: $chosen; font-weight: 600 }
details { border: 1px solid $lines; border-radius: .3rem; margin: .5rem 0; padding: .3rem .8rem }
summary { cursor: pointer; font-weight: 600; padding: .4rem 0 }
summary span { font-weight: 400; color: $less }
code { background: $faint; padding: 0 .2rem; overflow-wrap: anywhere }
ul { margin: .3rem 0; padding-left: 1.3rem }
@media (max-width: 600px) {
  body { margin: 1rem auto; padding: 0 .75rem } .verdict { font-size: 1.1rem }
  details { border: none; padding: 0 } td { max-width: 14rem; min-width: 6rem }
}
</style></head><body>
$body
<script id="plotly" type="application/gzip">$plotly</script>
<script id="figures" type="application/gzip">$figures</script>
<script>
"use strict";
let figures = {};
const config = {responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"]};

/* A zoom in time shows only that part of a path. */
function linkPathToTime(plot) {
  const paths = plot.data.map((trace, i) => trace.meta === "path" ? i : -1).filter(i => i >= 0);
  if (!paths.length) return;
  const {data} = figures[plot.id];
  const whole = paths.map(i => ({x: data[i].x, y: data[i].y, t: data[i].customdata}));
  let shown = "";
  plot.on("plotly_relayout", () => {
    const [from, to] = plot.layout.xaxis.range;
    if (shown === from + " " + to) return;
    shown = from + " " + to;
    const cut = key => whole.map(path => path[key].map((value, i) =>
      path.t[i] === null || path.t[i] >= from && path.t[i] <= to ? value : null));
    Plotly.restyle(plot, {x: cut("x"), y: cut("y")}, paths);
  });
}

async function draw(plot) {
  if (plot.dataset.drawn) return;
  plot.dataset.drawn = "begun";
  const {data, layout} = structuredClone(figures[plot.id]);  // a zoom cuts off paths
  await Plotly.newPlot(plot, data, layout, config);
  linkPathToTime(plot);
  plot.dataset.drawn = "yes";
}

function unpack(name) {
  const packed = atob(document.getElementById(name).textContent);
  const bytes = Uint8Array.from(packed, character => character.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

async function start() {
  const [code, data] = await Promise.all([unpack("plotly"), unpack("figures")]);
  const script = document.createElement("script");
  script.textContent = code;
  document.head.append(script);
  figures = JSON.parse(data);
  for (const plot of document.querySelectorAll(".figure"))
    if (!plot.closest("details:not([open])")) draw(plot);
  for (const details of document.querySelectorAll("details"))
    details.addEventListener("toggle", () => {
      if (details.open) details.querySelectorAll(".figure").forEach(plot => draw(plot));
    });
}

if (window.DecompressionStream && window.structuredClone) start();
else document.querySelectorAll(".figure").forEach(
  plot => { plot.textContent = "This plot needs a newer browser (Chrome 98, Firefox 113, Safari 16.4)."; });
</script></body></html>
""")


text = html.escape


class Page:
    """A page that grows from top to bottom."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._body: List[str] = []
        self._figures: Dict[str, str] = {}  # JSON, by name

    def add(self, markup: str) -> None:
        """Adds HTML without escaping it."""
        self._body.append(markup)

    def heading(self, text: str) -> None:
        """Adds a heading; special characters are escaped, here and below."""
        self.add("<h2>%s</h2>" % html.escape(text))

    def subheading(self, text: str) -> None:
        """Adds a heading of the second level."""
        self.add("<h3>%s</h3>" % html.escape(text))

    def paragraph(self, text: str, kind: str = "") -> None:
        """Adds a paragraph; kind: its class in the style sheet."""
        self.add('<p class="%s">%s</p>' % (kind, html.escape(text)))

    def points(self, lines: Iterable[str]) -> None:
        """Adds a bulleted list."""
        self.add("<ul>%s</ul>" % "".join("<li>%s</li>" % html.escape(line) for line in lines))

    def figure(self, figure: Document, hint: str = "") -> None:
        """Adds a figure, and below it its caption (from layout.meta) and a hint. One of several panels
        is scrolled sideways on a narrow screen."""
        name = "figure%d" % len(self._figures)
        self._figures[name] = json.dumps(figure, separators=(",", ":"), default=list)
        caption = " ".join(filter(None, (figure["layout"]["meta"], hint)))
        kind = "wide panels" if "xaxis2" in figure["layout"] else "wide"
        self.add(
            '<figure class="plot"><div class="%s"><div class="figure" id="%s" style="height:%dpx">'
            '</div></div><figcaption class="caption">%s</figcaption></figure>'
            % (kind, name, figure["layout"]["height"], html.escape(caption))
        )

    def table(
        self, head: Sequence[str], rows: Iterable[Sequence[object]], chosen: Sequence[int] = ()
    ) -> None:
        """Adds a table. A heading that begins with # marks a column of numbers, with = one whose text
        is not wrapped. `chosen`: highlighted rows."""
        kinds = [{"#": ' class="n"', "=": ' class="whole"'}.get(h[0], "") for h in head]

        def line(cells: Sequence[object], tag: str) -> str:
            return "".join(
                "<%s%s>%s</%s>" % (tag, kind, html.escape(str(c)).replace("\n", "<br>"), tag)
                for c, kind in zip(cells, kinds)
            )

        self.add(
            '<div class="wide"><table><thead><tr>%s</tr></thead>' % line([h.lstrip("#=") for h in head], "th")
        )
        for count, row in enumerate(rows):
            kind = ' class="chosen"' * (count in chosen)
            self.add("<tr%s>%s</tr>" % (kind, line(row, "td")))
        self.add("</table></div>")

    def fold(self, summary: str, beside: str, is_open: bool) -> None:
        """Begins a part that can be folded; its figures are drawn when it is opened."""
        words = "%s <span>%s</span>" % (html.escape(summary), html.escape(beside))
        self.add("<details%s><summary>%s</summary>" % (" open" * is_open, words))

    def end_fold(self) -> None:
        """Ends the part that `fold` began."""
        self.add("</details>")

    def write(self, path: str, color: str, force: bool = False) -> None:
        """Writes the page; raises GroundError when the file exists and `force` is not set."""
        text = PAGE.substitute(
            title=html.escape(self.title),
            color=color,
            text=appearance.TEXT,
            less=appearance.LESS,
            lines=appearance.LINES,
            faint=appearance.FAINT,
            chosen=appearance.CHOSEN,
            body="\n".join(self._body),
            plotly=_plotly(),
            figures=_packed("{%s}" % ",".join('"%s":%s' % item for item in self._figures.items())),
        )
        with files.new_file(path, force) as temporary:
            with open(temporary, "w", encoding="utf-8") as file:
                file.write(text)


@functools.lru_cache(maxsize=None)
def _plotly() -> str:
    from plotly.offline import get_plotlyjs

    return _packed(get_plotlyjs())


def _packed(contents: str) -> str:
    """Compressed text, a quarter of the size. Level 9 takes twice as long for 0.4% less."""
    packed = gzip.compress(contents.encode("utf-8"), compresslevel=7, mtime=0)
    return base64.b64encode(packed).decode("ascii")
