"""Pictures of plotly figures (PNG, SVG), drawn by matplotlib without a browser.

A figure is defined once, with plotly; the page shows it, and this module draws it into a file. It
draws the parts of plotly that ground.reports uses (KNOWN). Any other part is an error, so that a
picture never shows less than its figure. A pixel of a figure is a point (1/72 inch) of its picture.
"""

import re
import textwrap
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
from matplotlib import colors, transforms
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, MaxNLocator, StrMethodFormatter

from ground import files
from ground.annotations import Array, Document
from ground.errors import GroundError

WIDTH = 1040  # width of a figure, as on the page [points]
RESOLUTION = 100  # resolution of a PNG [dots per inch]
CAPTION, LINE_HEIGHT = 165, 17  # characters in a line of a caption, and its height [points]
PADDING = 2  # distance of a text from its anchor [points]
MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^"}
DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}

# Attributes of each part of a figure that are drawn, or that a static picture does not need.
_TRACE = "type x y name legendgroup showlegend visible xaxis yaxis"
_TRACE += " hovertemplate hoverinfo customdata meta cliponaxis"
_CELLS = "values height font fill line"
KNOWN = {
    "figure": "data layout narrow",  # narrow: for a page
    "layout": "template height font margin legend meta annotations shapes hovermode updatemenus",
    "margin": "l r t b",
    "legend": "orientation x y yanchor",
    "axis": "anchor domain title range type autorange matches scaleanchor side showticklabels "
    "ticks ticklen tickcolor tickfont nticks tickangle tickvals ticktext visible automargin rangemode "
    "zeroline zerolinecolor zerolinewidth",
    "title": "text font standoff side",
    "font": "size color family",
    "tickfont": "size",
    "scatter": _TRACE + " mode line marker opacity fill fillcolor error_x error_y",
    "line": "color width dash shape",
    "marker": "size color symbol colorscale cmin cmax colorbar",
    "colorbar": "x y len thickness title tickfont",
    "error_x": "array arrayminus color thickness width",
    "error_y": "array arrayminus color thickness width",
    "bar": _TRACE + " orientation text textposition marker",
    "heatmap": _TRACE + " z zmin zmax colorscale showscale",
    "table": "type domain columnwidth header cells",
    "header": _CELLS,
    "cells": _CELLS,
    "fill": "color",
    "domain": "x y",
    "shape": "type x0 x1 y0 y1 xref yref line fillcolor opacity layer",
    "annotation": "text x y xref yref xanchor yanchor yshift showarrow font bgcolor",
}
# The only values of these attributes that can be drawn.
VALUES = {
    "scatter.mode": ("lines", "markers", "lines+markers"),
    "scatter.fill": ("toself",),
    "line.shape": ("hv",),
    "bar.orientation": ("h",),
    "bar.textposition": ("outside",),
    "heatmap.showscale": (False,),
    "axis.autorange": ("reversed",),
    "axis.ticks": ("outside",),
    "axis.rangemode": ("tozero",),
    "legend.orientation": ("h",),
    "legend.yanchor": ("bottom",),
    "annotation.showarrow": (False,),
}


def write(path: str, figures: Sequence[Document], force: bool = False) -> None:
    """Draws figures one below the other, each under its caption, into a file.

    path: ends with .png or .svg; figures: as plotly's `to_plotly_json` gives them, with
    layout.height, layout.margin, layout.font.size, and a caption in layout.meta; force: overwrite.
    GroundError when a figure has a part that is not in KNOWN, or the file cannot be written.
    """
    drawn = draw(figures)
    with files.new_file(path, force) as temporary:
        drawn.savefig(temporary, dpi=RESOLUTION)


def draw(figures: Sequence[Document]) -> Figure:
    """The figures as one figure of matplotlib. Artists of a trace have the gid "FIGURE.TRACE"."""
    captions = [textwrap.wrap(figure["layout"].get("meta", ""), CAPTION) for figure in figures]
    heights = [figure["layout"]["height"] for figure in figures]
    total = sum(heights) + LINE_HEIGHT * sum(map(len, captions))
    whole = Figure(figsize=(WIDTH / 72, total / 72))
    FigureCanvasAgg(whole)
    top = float(total)
    for count, (figure, caption, height) in enumerate(zip(figures, captions, heights)):
        for text in caption:
            top -= LINE_HEIGHT
            whole.text(12 / WIDTH, top / total, _escaped(text), fontsize=11, color="#444444")
        _Drawing(whole, figure, top - height, str(count))
        top -= height
    return whole


class _Drawing:
    """One figure of plotly inside a figure of matplotlib, `bottom` points above its lower edge."""

    def __init__(self, whole: Figure, figure: Document, bottom: float, gid: str) -> None:
        _check("figure", figure)
        self.whole, self.bottom, self.layout = whole, bottom, figure["layout"]
        axes = [key for key in self.layout if re.match(r"[xy]axis\d*$", key)]
        _check("layout", {key: part for key, part in self.layout.items() if key not in axes})
        self.margin = dict(_part("margin", self.layout))
        self.size = _part("font", self.layout)["size"]
        self.axes: Dict[str, Any] = {}  # by the names of the x axis and of the y axis
        self.boxes: List[Tuple[Any, Sequence[float], Sequence[float]]] = []  # axes, domains
        self.bars: List[Tuple[Any, Document]] = []  # axes and description of colour bars
        self.categories: Dict[str, List[str]] = {}  # by axis
        self.legend: Dict[str, Tuple[Any, str]] = {}
        for key in axes:
            _check("axis", self.layout[key])
            if key.startswith("x"):
                self._add_axes("x" + key[len("xaxis") :])
        for count, trace in enumerate(figure["data"]):
            if trace.get("visible", True):
                self._draw_trace(trace, "%s.%d" % (gid, count))
        for name in self.axes:
            self._dress(name)
        self._place()
        self._grow_margins()
        for name in self.axes:
            if "scaleanchor" in self._described(name):
                self._widen_range(self.axes[name])
        for shape in self.layout.get("shapes", ()):
            self._draw_shape(shape)
        for note in self.layout.get("annotations", ()):
            self._draw_annotation(note)
        self._draw_legend()

    # Positions

    def _described(self, name: str) -> Document:
        """Description of an axis, by the name that traces use, such as x2."""
        axis: Document = self.layout.get(name[0] + "axis" + name[1:], {})
        return axis

    def _add_axes(self, x: str) -> None:
        y = self._described(x).get("anchor", "y")
        share: Document = {}
        for name in (x, y):
            followed = self._described(name).get("matches", name)
            share["share" + name[0]] = next(
                (
                    axes
                    for other, axes in self.axes.items()
                    if followed in (other, self._described(other).get("matches"))
                ),
                None,
            )
        axes = self._new_axes(
            *(self._described(name).get("domain", (0, 1)) for name in (x, y)), **share
        )
        self.axes[x] = self.axes[y] = axes

    def _new_axes(self, x: Sequence[float], y: Sequence[float], **share: Any) -> Any:
        """Axes of matplotlib; x, y: their start and end, as shares of the plotting area."""
        axes = self.whole.add_axes((0, 0, 1, 1), label=str(len(self.whole.axes)), **share)
        self.boxes.append((axes, x, y))
        return axes

    def _box(self, x: Sequence[float], y: Sequence[float]) -> Tuple[float, float, float, float]:
        """Left, bottom, width, height as shares of the whole."""
        margin, height = self.margin, self.whole.get_figheight() * 72
        wide = WIDTH - margin["l"] - margin["r"]
        tall = self.layout["height"] - margin["t"] - margin["b"]
        left, bottom = margin["l"] + x[0] * wide, self.bottom + margin["b"] + y[0] * tall
        size = (x[1] - x[0]) * wide / WIDTH, (y[1] - y[0]) * tall / height
        return (left / WIDTH, bottom / height) + size

    def _place(self) -> None:
        for axes, x, y in self.boxes:
            axes.set_position(self._box(x, y))
        for axes, bar in self.bars:
            ends = bar["y"] - bar["len"] / 2, bar["y"] + bar["len"] / 2
            left, bottom, _, height = self._box((bar["x"], 1), ends)
            axes.set_position((left, bottom, bar["thickness"] / WIDTH, height))

    def _grow_margins(self) -> None:
        """Makes room for the labels of axes with `automargin`."""
        renderer = self.whole.canvas.get_renderer()
        for name, axes in self.axes.items():
            axis, side, edge = (
                (axes.xaxis, "b", "y0") if name[0] == "x" else (axes.yaxis, "l", "x0")
            )
            labels = axis.get_tightbbox(renderer)
            if self._described(name).get("automargin") and labels is not None:
                needed = getattr(axes.get_window_extent(renderer), edge) - getattr(labels, edge)
                self.margin[side] = max(self.margin[side], needed * 72 / self.whole.dpi + 8)
        self._place()

    def _widen_range(self, axes: Any) -> None:
        """Gives both axes the same scale."""
        wide, tall = axes.get_window_extent().size
        x, y = axes.get_xlim(), axes.get_ylim()
        scale = max((x[1] - x[0]) / wide, (y[1] - y[0]) / tall)
        axes.set_xlim(np.mean(x) + scale * wide * np.array([-0.5, 0.5]))
        axes.set_ylim(np.mean(y) + scale * tall * np.array([-0.5, 0.5]))

    # Traces

    def _draw_trace(self, trace: Document, gid: str) -> None:
        drawing = getattr(self, "_draw_" + trace["type"], None)
        if trace["type"] not in KNOWN or drawing is None:
            raise _refusal("a trace of type " + trace["type"])
        _check(trace["type"], trace)
        axes = self.axes.get(trace.get("xaxis", "x"))
        if trace["type"] != "table" and axes is not self.axes[trace.get("yaxis", "y")]:
            raise _refusal("two y axes over one x axis")
        artist = drawing(axes, trace)
        for part in artist if isinstance(artist, tuple) else (artist,):
            part.set_gid(gid)
        if trace.get("name") and trace.get("showlegend", True):
            self.legend.setdefault(trace.get("legendgroup", gid), (artist, trace["name"]))

    def _draw_scatter(self, axes: Any, trace: Document) -> Any:
        x, y = _numbers(trace["x"]), _numbers(trace["y"])
        line, marker = _part("line", trace), _part("marker", trace)
        lines, points = "lines" in trace["mode"], "markers" in trace["mode"]
        for name in ("error_x", "error_y"):
            error = _part(name, trace)
            if error:
                above, below = error["array"], error.get("arrayminus", error["array"])
                style = {"elinewidth": error["thickness"], "capsize": error["width"]}
                style[name[-1] + "err"] = [_numbers(below), _numbers(above)]
                axes.errorbar(x, y, fmt="none", ecolor=_color(error["color"]), **style)
        if "fill" in trace:
            return self._draw_fill(axes, x, y, trace)
        if "colorscale" in marker:
            return self._draw_points(axes, x, y, marker, trace.get("opacity", 1.0))
        (artist,) = axes.plot(
            x,
            y,
            color=_color((line if lines else marker)["color"]),
            alpha=trace.get("opacity", 1.0),
            linewidth=line.get("width", 2),
            linestyle=DASHES[line.get("dash", "solid")] if lines else "none",
            drawstyle="steps-post" if "shape" in line else "default",
            marker=MARKERS[marker.get("symbol", "circle")] if points else "",
            markersize=marker.get("size", 6),
            markeredgewidth=0,
        )
        return artist

    def _draw_fill(self, axes: Any, x: Array, y: Array, trace: Document) -> Any:
        if trace["line"]["width"] > 0:
            raise _refusal("a line around a filled area")
        whole = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        parts = np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1)
        outlines = [np.column_stack([x[part], y[part]]) for part in parts]
        artist = PolyCollection(outlines, facecolors=[_color(trace["fillcolor"])], linewidths=0)
        axes.add_collection(artist)
        axes.autoscale_view()
        return artist

    def _draw_points(self, axes: Any, x: Array, y: Array, marker: Document, opacity: float) -> Any:
        """Points whose colours are numbers, and their colour bar."""
        values, bar = _numbers(marker["color"]), _part("colorbar", marker)
        artist = axes.scatter(
            x,
            y,
            c=values,
            s=marker["size"] ** 2,
            marker=MARKERS[marker.get("symbol", "circle")],
            cmap=_scale(marker["colorscale"]),
            vmin=marker.get("cmin", values.min()),
            vmax=marker.get("cmax", values.max()),
            alpha=opacity,
            linewidths=0,
        )
        beside = self.whole.add_axes((0, 0, 1, 1), label=str(len(self.whole.axes)))
        self.whole.colorbar(artist, cax=beside, ticks=MaxNLocator(4)).outline.set_visible(False)
        beside.tick_params(labelsize=_part("tickfont", bar).get("size", self.size), length=2)
        self._set_title(beside.yaxis, _part("title", bar))
        self.bars.append((beside, bar))
        return artist

    def _draw_bar(self, axes: Any, trace: Document) -> Any:
        places = self._set_categories(axes, trace, "y")
        shades = [_color(shade) for shade in _part("marker", trace)["color"]]
        artist = axes.barh(places, _numbers(trace["x"]), 0.8, color=shades)
        for place, length, text in zip(places, trace["x"], trace["text"]):
            style = {"textcoords": "offset points", "va": "center", "fontsize": self.size}
            axes.annotate(_escaped(text), (length, place), (PADDING, 0), **style)
        return artist

    def _draw_heatmap(self, axes: Any, trace: Document) -> Any:
        columns, rows = (self._set_categories(axes, trace, name) for name in "xy")
        edges = [np.arange(len(places) + 1) - 0.5 for places in (columns, rows)]
        limits = {"vmin": trace["zmin"], "vmax": trace["zmax"]}
        values = np.array(trace["z"], float)
        return axes.pcolormesh(*edges, values, cmap=_scale(trace["colorscale"]), **limits)

    def _set_categories(self, axes: Any, trace: Document, name: str) -> Any:
        """Places of the categories of a trace along one of its axes, which it labels."""
        self.categories[trace.get(name + "axis", name)] = list(trace[name])
        axis = axes.xaxis if name == "x" else axes.yaxis
        places = np.arange(len(trace[name]))
        axis.set_ticks(places)
        axis.set_ticklabels([_plain(label)[0] for label in trace[name]])
        return places

    def _draw_table(self, _: Any, trace: Document) -> Any:
        header, cells = _part("header", trace), _part("cells", trace)
        domain = _part("domain", trace)
        axes = self._new_axes(domain["x"], domain["y"])
        axes.axis("off")
        table = axes.table(
            cellText=[[_escaped(text) for text in row] for row in zip(*cells["values"])],
            colLabels=[_escaped(text) for text in header["values"]],
            colWidths=np.array(trace["columnwidth"]) / np.sum(trace["columnwidth"]),
            cellLoc="center",
            bbox=(0, 0, 1, 1),
        )
        table.auto_set_font_size(False)
        for (row, column), cell in table.get_celld().items():
            part = cells if row else header
            font = _part("font", part)
            shade = font["color"][column][row - 1] if row else font["color"]
            cell.get_text().set(fontsize=font["size"], color=_color(shade))
            cell.set(height=part["height"], facecolor=_color(_part("fill", part)["color"]))
            cell.set_edgecolor(_color(_part("line", part)["color"]))
        return table

    # Axes, shapes, annotations and the legend

    def _dress(self, name: str) -> None:
        """Ticks, title, range and grid of an axis."""
        described, axes = self._described(name), self.axes[name]
        axis = axes.xaxis if name[0] == "x" else axes.yaxis
        set_limits = axes.set_xlim if name[0] == "x" else axes.set_ylim
        log = described.get("type") == "log"
        if log:
            (axes.set_xscale if name[0] == "x" else axes.set_yscale)("log")
            low, high = axis.get_view_interval()
            if high < 100 * low:
                axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        if "range" in described:
            ends = np.array(described["range"], float)
            set_limits(np.power(10, ends) if log else ends)
        elif "rangemode" in described:
            set_limits(0, None)
        if "autorange" in described:
            set_limits(sorted(axis.get_view_interval(), reverse=True))
        if "tickvals" in described:
            axis.set_ticks(described["tickvals"])
            axis.set_ticklabels([_escaped(text) for text in described["ticktext"]])
        elif "nticks" in described:
            axis.set_major_locator(MaxNLocator(described["nticks"]))
        side = described.get("side", {"x": "bottom", "y": "left"}[name[0]])
        axis.set_ticks_position(side)
        axis.set_label_position(side)
        labels = {"labelsize": _part("tickfont", described).get("size", self.size)}
        labels["label" + side] = described.get("showticklabels", True)
        length, color = described.get("ticklen", 2), described.get("tickcolor", "#c8c8c8")
        axis.set_tick_params(length=length, color=color, **labels)
        for label in axis.get_ticklabels() if "tickangle" in described else ():
            label.set(rotation=-described["tickangle"], ha="right", rotation_mode="anchor")
        if described.get("zeroline"):
            style = {
                "color": described["zerolinecolor"],
                "lw": described["zerolinewidth"],
                "zorder": 1,
            }
            (axes.axvline if name[0] == "x" else axes.axhline)(0, **style)
        if name not in self.categories:
            axis.grid(True, color="#e3e3e3", linewidth=0.7)
        axes.set_axisbelow(True)
        for spine in axes.spines.values():
            spine.set(color="#c8c8c8", linewidth=0.8)
        self._set_title(axis, _part("title", described))
        if described.get("visible") is False:
            axes.axis("off")

    def _set_title(self, axis: Any, title: Document) -> None:
        text, weight = _plain(title.get("text", ""))
        size = _part("font", title).get("size", self.size)
        axis.set_label_text(text, fontsize=size, fontweight=weight)

    def _draw_shape(self, shape: Document) -> None:
        _check("shape", shape)
        style: Document = {"transform": self._transform(shape["xref"], shape["yref"])}
        style.update(zorder=0.5 if shape.get("layer") == "below" else 2.5, gid="shape")
        axes = self.axes[shape["xref"].split()[0]]
        line = _part("line", shape)
        x, y = (shape["x0"], shape["x1"]), (shape["y0"], shape["y1"])
        if shape["type"] == "line":
            style.update(color=_color(line["color"]), linewidth=line["width"])
            axes.plot(x, y, linestyle=DASHES[line.get("dash", "solid")], **style)
        elif shape["type"] == "rect" and line["width"] == 0:
            style["facecolor"] = _color(shape["fillcolor"], shape.get("opacity", 1.0))
            axes.add_patch(Rectangle((x[0], y[0]), x[1] - x[0], y[1] - y[0], linewidth=0, **style))
        else:
            raise _refusal("a shape of type " + shape["type"])

    def _draw_annotation(self, note: Document) -> None:
        _check("annotation", note)
        font, anchor = _part("font", note), note.get("yanchor", "middle")
        text, weight = _plain(note["text"])
        up = note.get("yshift", 0) + {"bottom": PADDING, "middle": 0, "top": -PADDING}[anchor]
        shift = transforms.ScaledTranslation(0, up / 72, self.whole.dpi_scale_trans)
        box = {"facecolor": _color(note.get("bgcolor", "white")), "linewidth": 0, "pad": 1}
        self.whole.text(
            self._value(note["x"], note["xref"]),
            self._value(note["y"], note["yref"]),
            text,
            transform=self._transform(note["xref"], note["yref"]) + shift,
            ha=note.get("xanchor", "center"),
            va={"middle": "center"}.get(anchor, anchor),
            multialignment="center",
            fontsize=font.get("size", self.size),
            color=_color(font.get("color", "#222222")),
            fontweight=weight,
            bbox=box if "bgcolor" in note else None,
            gid="annotation",
        )

    def _value(self, value: Any, ref: str) -> Any:
        """A coordinate for matplotlib."""
        if self._described(ref).get("type") == "log":
            raise _refusal("an annotation at a value of a logarithmic axis")
        return self.categories[ref].index(value) if isinstance(value, str) else value

    def _transform(self, xref: str, yref: str) -> Any:
        """Transformation from coordinates along an axis, its domain or the plotting area (paper)."""
        left, bottom, width, height = self._box((0, 1), (0, 1))
        area = transforms.Affine2D().scale(width, height).translate(left, bottom)
        area = area + self.whole.transFigure

        def along(ref: str) -> Any:
            if ref == "paper":
                return area
            axes = self.axes[ref.split()[0]]
            return axes.transAxes if ref.endswith(" domain") else axes.transData

        return transforms.blended_transform_factory(along(xref), along(yref))

    def _draw_legend(self) -> None:
        """Draws the legend in rows above the plotting area, each with as many entries as fit."""
        if not self.legend:
            return
        described = _part("legend", self.layout)
        artists, names = zip(*self.legend.values())
        labels = [_escaped(name) for name in names]
        style = {"fontsize": self.size, "frameon": False, "borderaxespad": 0, "borderpad": 0}
        style["bbox_to_anchor"] = self._box((described["x"], 1), (described["y"], 2))[:2]
        for columns in range(len(labels), 0, -1):
            drawn = self.whole.legend(artists, labels, loc="lower left", ncol=columns, **style)
            extent = drawn.get_window_extent(self.whole.canvas.get_renderer())
            if columns == 1 or extent.x1 <= self.whole.bbox.x1:
                return
            drawn.remove()


def _check(kind: str, given: Document) -> None:
    """Raises GroundError when a part has an attribute or a value that cannot be drawn."""
    for key, value in given.items():
        name = "%s.%s" % (kind, key)
        if key not in KNOWN[kind].split():
            raise _refusal(name)
        if name in VALUES and value not in VALUES[name]:
            raise _refusal("%s %r" % (name, value))


def _part(kind: str, given: Document) -> Document:
    """A part of a part, checked; empty if it is missing."""
    part: Document = given.get(kind, {})
    _check(kind, part)
    return part


def _refusal(what: str) -> GroundError:
    return GroundError("a picture cannot show %s; see ground.reports.picture" % what)


def _numbers(values: Any) -> Array:
    return np.array([np.nan if value is None else value for value in values], float)


def _color(text: str, opacity: float = 1.0) -> Tuple[float, ...]:
    """Red, green, blue, opacity (0..1) of a colour as CSS writes it."""
    found = re.match(r"rgba?\((.*)\)$", text)
    if not found:
        return tuple(colors.to_rgba(text, opacity))
    red, green, blue, alpha = ([float(n) for n in found.group(1).split(",")] + [1.0])[:4]
    return red / 255, green / 255, blue / 255, alpha * opacity


def _scale(scale: Sequence[Tuple[float, str]]) -> Any:
    """A colour map of matplotlib."""
    return colors.LinearSegmentedColormap.from_list("", [(at, _color(c)) for at, c in scale])


def _plain(text: str) -> Tuple[str, str]:
    """A text without plotly's markup, and its font weight."""
    plain = re.sub("</?b>", "", text.replace("<br>", "\n"))
    if re.search("<[a-z/]", plain):
        raise _refusal("the markup in " + text)
    return _escaped(plain), "bold" if text.startswith("<b>") else "normal"


def _escaped(text: str) -> str:
    """Escapes dollars, which would begin a formula."""
    return text.replace("$", r"\$")
