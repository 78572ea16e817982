"""Pages of text, tables and interactive figures: one file that needs no network."""

import base64
import functools
import gzip
import html
import json
import string
from concurrent.futures import ThreadPoolExecutor
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
.plot { margin: 0 } .figure { overflow: hidden }
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
.paper { display: none; font-weight: 600 } .paper span { font-weight: 400; color: $less }
code { background: $faint; padding: 0 .2rem; overflow-wrap: anywhere }
ul { margin: .3rem 0; padding-left: 1.3rem }
@media (max-width: 600px) {
  body { margin: 1rem auto; padding: 0 .75rem } .verdict { font-size: 1.1rem }
  details { border: none; padding: 0 } td { max-width: 14rem }
}
@page { size: A4; margin: 12mm }
@media print {
  body { margin: 0; max-width: none; padding: 0; font-size: 9.5pt; line-height: 1.35 }
  h1 { margin-top: 0 } h2 { margin: .9rem 0 .3rem } h3 { margin: .5rem 0 .1rem }
  h1, h2, h3, thead, .caption:has(+ .wide) { break-after: avoid }
  p, ul { margin: .3rem 0; orphans: 3; widows: 3 }
  tr:first-child, tr:nth-child(2) { break-after: avoid }
  .plot, tr, li, .verdict, .paper, h1, h2, h3 { break-inside: avoid }
  .modebar { display: none }
  details { border: none; padding: 0; margin: 0 } details:not([open]), summary { display: none }
  table { font-size: 7.5pt } th, td { padding: .1rem .4rem } .wide { overflow: visible }
  .screen { display: none } .paper { display: block; break-after: avoid }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact }
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

/* Draws a figure as wide as its place, or for paper: its panels one below the other on a narrow page. */
const NARROW = 600, PAPER = 700, PAPER_HEIGHT = 0.76;
function arranged(plot, paper) {
  const {data, layout, narrow} = figures[plot.id];
  if (paper)
    return {data, layout: {...layout, width: PAPER, height: PAPER_HEIGHT * layout.height, updatemenus: []}};
  if (plot.clientWidth >= NARROW || !narrow) return {data, layout};
  const changed = {...layout};
  for (const [key, value] of Object.entries(narrow.layout))
    changed[key] = value instanceof Object && !Array.isArray(value) ? {...layout[key], ...value} : value;
  const bars = data.map((trace, i) => !narrow.traces[i] ? trace : {...trace, marker:
    {...trace.marker, colorbar: {...trace.marker.colorbar, ...narrow.traces[i].colorbar}}});
  return {data: bars, layout: changed, isNarrow: true};
}

async function draw(plot, paper = false) {
  const {data, layout, isNarrow} = arranged(plot, paper);
  const form = paper ? "paper" : isNarrow ? "narrow" : "wide";
  if (plot.dataset.form === form) return;
  plot.dataset.form = form;
  plot.dataset.drawn = "begun";
  plot.style.height = layout.height + "px";
  const traces = data.map(trace => ({...trace}));  // a zoom cuts off paths
  const bar = {displayModeBar: !isNarrow && "hover"};
  await Plotly.newPlot(plot, traces, JSON.parse(JSON.stringify(layout)), {...config, ...bar});
  linkPathToTime(plot);
  plot.dataset.drawn = "yes";
}
const drawAll = paper => document.querySelectorAll(".figure[data-drawn]").forEach(p => draw(p, paper));

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
  window.addEventListener("resize", () => drawAll(false));
  window.addEventListener("beforeprint", () => drawAll(true));
  window.addEventListener("afterprint", () => drawAll(false));
}

if (window.DecompressionStream) start();
else document.querySelectorAll(".figure").forEach(
  plot => { plot.textContent = "This plot needs a newer browser (Chrome 80, Firefox 113, Safari 16.4)."; });
</script></body></html>
""")


text = html.escape


class Page:
    """A page that grows from top to bottom."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._library = _packing().submit(_plotly)  # while the page grows
        self._body: List[str] = []
        self._figures: Dict[str, Document] = {}

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
        """Adds a plotly figure, and below it its caption (from layout.meta) and a hint."""
        name = "figure%d" % len(self._figures)
        self._figures[name] = figure
        height = figure["layout"]["height"]
        caption = " ".join(filter(None, (figure["layout"]["meta"], hint)))
        self.add(
            '<figure class="plot"><div class="figure" id="%s" style="height:%dpx"></div>'
            '<figcaption class="caption">%s</figcaption></figure>'
            % (name, height, html.escape(caption))
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
            '<div class="wide"><table><thead><tr>%s</tr></thead>'
            % line([h.lstrip("#=") for h in head], "th")
        )
        for count, row in enumerate(rows):
            kind = ' class="chosen"' * (count in chosen)
            self.add("<tr%s>%s</tr>" % (kind, line(row, "td")))
        self.add("</table></div>")

    def fold(self, summary: str, beside: str, is_open: bool) -> None:
        """Begins a part that can be folded; its figures are drawn when it is opened. A paragraph with
        the same words stands for the summary on paper, where nothing keeps a summary from staying
        behind at the end of a page."""
        words = "%s <span>%s</span>" % (html.escape(summary), html.escape(beside))
        self.add(
            '<details%s><summary>%s</summary><p class="paper">%s</p>'
            % (" open" * is_open, words, words)
        )

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
            plotly=self._library.result(),
            figures=_packed(json.dumps(self._figures, separators=(",", ":"), default=list)),
        )
        with files.new_file(path, force) as temporary:
            with open(temporary, "w", encoding="utf-8") as file:
                file.write(text)


@functools.lru_cache(maxsize=None)
def _packing() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


@functools.lru_cache(maxsize=None)
def _plotly() -> str:
    from plotly.offline import get_plotlyjs

    return _packed(get_plotlyjs())


def _packed(contents: str) -> str:
    """Compressed text, a quarter of the size. Level 9 takes twice as long for 0.4% less."""
    packed = gzip.compress(contents.encode("utf-8"), compresslevel=7, mtime=0)
    return base64.b64encode(packed).decode("ascii")
