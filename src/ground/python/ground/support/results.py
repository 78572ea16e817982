"""How results show themselves, and names that differ from each other."""

import html
import os
from collections import Counter
from typing import TYPE_CHECKING, Any, Collection, Iterator, List, Mapping, Sequence

from ground.support import headline
from ground.support.docstrings import Described, internal
from ground.support.headline import Line
from ground.support.public import public

if TYPE_CHECKING:
    import pandas


class Plotted(Described):
    """What has figures."""

    def plot(self, name: str = "") -> Any:
        """Draws its figures; see ground.plot.

        Parameters
        ----------
        name : str, optional
            Name of one figure.

        Returns
        -------
        plotly.graph_objects.Figure or Figures
            The figure of that name, or the only one; else all.
        """
        return public("plot")(self, name)


class Shown(Described):
    """A result. Printed, it is what the command line prints; a notebook shows its first lines and its
    table."""

    @internal
    def headline(self, written: str = "") -> Sequence[Line]:
        """Its first lines: the answer, its size, the file or folder that it was written to, and what to do
        next."""
        return []

    @internal
    def table(self) -> Iterator[str]:
        """The numbers that stand below them."""
        yield from ()

    @internal
    def details(self) -> Iterator[str]:
        """The evidence, in lines."""
        yield from ()

    @internal
    def lines(self, written: str = "") -> Iterator[str]:
        """The lines that the command line prints."""
        yield from headline.formatted(self.headline(written))
        for i, line in enumerate(self.table()):
            yield from [""] * (i == 0) + [line]

    def summary(self) -> str:
        """All of it, as --details prints it."""
        return "\n".join([*self.lines(), "", *self.details()])

    def to_frame(self) -> "pandas.DataFrame":
        """Its numbers as a table."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """The result in a line."""
        for label, text in self.headline():
            return "%s: %s" % (label, text)
        return next(iter(self.lines()), "")

    def __repr__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        told = "\n".join(headline.formatted(self.headline())) or self.title
        table = self.to_frame().to_html(max_rows=20, float_format="{:.4g}".format)
        return "<pre>%s</pre>%s" % (html.escape(told), table)


def with_units(frame: "pandas.DataFrame", units: Mapping[str, str]) -> "pandas.DataFrame":
    """The table with units of its columns in attrs["units"]; pandas before 1.0 has no attrs."""
    if hasattr(frame, "attrs"):
        frame.attrs["units"] = dict(units)
    return frame


def distinct_labels(
    labels: Sequence[str], paths: Sequence[str], reserved: Collection[str] = (), link: str = "/"
) -> List[str]:
    """Labels that differ from each other and from reserved ones. One that does not gets names of folders
    of its path in front, as many as it takes, or a number where these are no help. paths: "" for what is
    not a file; link: joins the names."""
    counts = Counter([*labels, *set(reserved)])
    used = {*reserved, *(label for label in labels if counts[label] == 1)}
    found = list(labels)
    for label in [label for label in counts if counts[label] > 1]:
        places = [i for i, other in enumerate(labels) if other == label]
        for i, name in zip(places, _with_folders(label, [paths[i] for i in places], used, link)):
            found[i] = name
            number = 2
            while found[i] in used:
                found[i], number = "%s-%d" % (name, number), number + 1
            used.add(found[i])
    return found


def _with_folders(label: str, paths: Sequence[str], used: Collection[str], link: str) -> List[str]:
    """A label with as few folders of each path as make it unique; the label itself without a path."""
    folders = [os.path.dirname(os.path.abspath(path)).split(os.sep) if path else [] for path in paths]
    found = [label] * len(paths)
    for depth in range(1, 1 + max(map(len, folders))):
        found = [link.join([*filter(None, names[-depth:]), label]) for names in folders]
        if len(set(found)) == len(found) and not set(found) & set(used):
            break
    return found
