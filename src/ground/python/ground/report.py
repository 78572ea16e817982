"""The page that shows a diagnosis: report.html, one file that opens anywhere."""
import base64
import datetime
import html
import os
import platform
import shlex
import string
import sys
import tempfile

from ground import comparison, files, words
from ground.words import number

SHOWN = 12  # rows of the table of candidates
PAGE = string.Template(
    """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Diagnosis of $model</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 68rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.4rem } h2 { font-size: 1.1rem; margin-top: 2rem }
.verdict { font-size: 1.25rem; border-left: .4rem solid $color; padding: .5rem 1rem; background: #f6f6f4 }
table { border-collapse: collapse; font-size: .85rem; width: 100% }
th, td { text-align: left; padding: .25rem .6rem; border-bottom: 1px solid #ddd; vertical-align: top }
td.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums } tr.chosen { background: #e6f2e8 }
img { max-width: 100% } code { background: #f2f2f0; padding: 0 .2rem; overflow-wrap: anywhere } .wide { overflow-x: auto }
@media print { body { margin: 0; font-size: 11pt } h2, img, tr { break-inside: avoid } }
</style></head><body>
<h1>What does $model lack?</h1>
<p class="verdict">$verdict</p>
<p><img alt="error after each step" src="$fall"></p>
<h2>Evidence</h2>
<p>Each effect beside the refitted nominal model. <i>p</i>: chance of so much evidence without the effect,
corrected for the number of effects tried. ΔBIC: below 0 speaks for it. Inclusion: how often it would be
first, had other stretches been recorded. Error: see below. Brackets: 95% intervals.</p>
<div class="wide"><table><tr><th>rank</th><th>effect</th><th>p</th><th>ΔBIC</th><th>inclusion</th><th>error, fitted</th>
<th>error, held out</th><th>parameters</th><th>cannot be told from</th></tr>$candidates</table></div>
<h2>Improved model</h2>
<div class="wide"><table><tr><th>parameter</th><th>nominal</th><th>improved</th><th>95% interval</th><th>unit</th></tr>$parameters</table></div>
$apart
$unexplained
<h2>Measured and simulated</h2>
$pictures
<h2>How it was made</h2>
<p><code>$command</code><br>$date, Python $python. Runs: $runs. Error: mean over samples of |e_u|/σ_u + |e_v|/σ_v +
|e_r|/σ_r, windows of 1.5 s, each from initial velocities of its own; held out: $heldout. Noise floor:
$floor, what the noise of the poses alone leaves.</p>
</body></html>
"""
)
COLORS = {"complete": "#2a9d5c", "missing": "#1f77b4", "unexplained": "#e08e0b"}


def write(path, report, found, conclusion, force=False):
    """Writes the page of a report (ground.diagnosis_report) of a Diagnosis and its Conclusion."""
    text = html.escape
    heldout = report["runs"]["heldout"]
    page = PAGE.substitute(
        model=text(os.path.basename(report["model"])),
        color=COLORS[report["verdict"]],
        verdict=text(words.verdict(report)),
        fall=_picture(lambda name, plots: plots.error_fall(name, report, True)),
        candidates="".join(_candidate(c) for c in report["candidates"][:SHOWN]),
        parameters="".join(_parameter(n, report) for n in report["improved"]["parameters"]),
        apart="".join("<p>%s</p>" % text(line) for line in words.apart(report)),
        unexplained="".join("<p>%s</p>" % text(line) for line in words.unexplained(report)),
        pictures="".join(_comparisons(found, conclusion)),
        command=text("identify " + " ".join(map(shlex.quote, sys.argv[1:]))),
        date=datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        python=platform.python_version(),
        runs=text(", ".join(report["runs"]["fit"])),
        heldout=text(
            ", ".join(heldout)
            if heldout != report["runs"]["fit"]
            else "each run (or quarter of a single one) by a fit to the others"
        ),
        floor=number(report["noise_floor"]),
    )
    with files.new_file(path, force) as temporary:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(page)


def _candidate(c):
    parameters = "<br>".join(html.escape(line) for line in words.parameters(c["parameters"]))
    rivals = ", ".join(name for name in c["group"] if name != c["effect"])
    cells = [
        ("n", c["rank"]),
        ("", html.escape(c["effect"])),
        ("n", "%.1g" % c["p_value"]),
        ("n", "%.0f" % c["delta_bic"]),
        ("n", "%.0f%%" % (100 * c["inclusion"])),
        ("n", number(c["error"]["fit"])),
        ("n", number(c["error"]["heldout"])),
        ("", parameters),
        ("", html.escape(rivals)),
    ]
    row = "".join('<td class="%s">%s</td>' % cell for cell in cells)
    return '<tr class="%s">%s</tr>' % ("chosen" if c["selected"] else "", row)


def _parameter(name, report):
    p = report["improved"]["parameters"][name]
    nominal = report["nominal"]["parameters"].get(name)
    interval = "%.4g to %.4g" % tuple(p["ci95"]) if p["identified"] else "these data do not tell it"
    return "<tr><td>%s</td><td class=n>%s</td><td class=n>%.4g</td><td>%s</td><td>%s</td></tr>" % (
        html.escape(name),
        "%.4g" % nominal["value"] if nominal else "",
        p["value"],
        interval,
        html.escape(p["unit"]),
    )


def _comparisons(found, conclusion):
    """A picture of each run against the refitted nominal and the improved model."""
    models = [("nominal, refitted", found.nominal.model)]
    if found.chosen:
        models.append(("improved", conclusion.improved))
    for run in found.runs:
        studies = []
        for label, model in models:
            evaluation = comparison.evaluate(run, model)
            studies.append(
                {
                    "label": label,
                    "run": run,
                    "model": model,
                    "role": "fit",
                    "evaluation": evaluation,
                    "numbers": comparison.numbers([evaluation]),
                }
            )
        source = _picture(lambda name, plots: plots.comparison(name, studies, True))
        yield '<p><img alt="%s" src="%s"></p>' % (html.escape(run.name), source)


def _picture(draw):
    """What draw(path, plots) draws, as a data URL."""
    from ground import plots

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "picture.png")
        draw(path, plots)
        with open(path, "rb") as file:
            return "data:image/png;base64," + base64.b64encode(file.read()).decode()
