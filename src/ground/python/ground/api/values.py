"""Shared by the modules of the API: labels, tables, and how results look in a notebook."""

import html
import os
from collections import Counter
from typing import Collection, Iterable, List, Optional, Sequence, Tuple

Row = Sequence[str]


def table(head: Row, rows: Iterable[Row], title: str = "") -> str:
    """An HTML table; the first column is of names, the others are of numbers."""

    def line(cells: Row, tag: str) -> str:
        sides = ["left"] + ["right"] * (len(cells) - 1)
        return "<tr>%s</tr>" % "".join(
            '<%s style="text-align:%s">%s</%s>' % (tag, side, html.escape(cell), tag)
            for cell, side in zip(cells, sides)
        )

    caption = "<caption>%s</caption>" % html.escape(title) if title else ""
    body = "".join(line(row, "td") for row in rows)
    return "<table>%s<thead>%s</thead><tbody>%s</tbody></table>" % (caption, line(head, "th"), body)


def text_table(head: Row, rows: Iterable[Row]) -> List[str]:
    """A table as lines of text; the first column is of names, the others are of numbers."""
    lines = [list(head)] + [list(row) for row in rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    return [
        "  ".join(
            [line[0].ljust(widths[0])] + [cell.rjust(w) for cell, w in zip(line[1:], widths[1:])]
        ).rstrip()
        for line in lines
    ]


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


def _with_folders(
    label: str, paths: Sequence[str], used: Collection[str], link: str
) -> List[str]:
    """A label with as few folders of each path as make it unique; the label itself without a path."""
    folders = [os.path.dirname(os.path.abspath(path)).split(os.sep) if path else [] for path in paths]
    found = [label] * len(paths)
    for depth in range(1, 1 + max(map(len, folders))):
        found = [link.join([*filter(None, names[-depth:]), label]) for names in folders]
        if len(set(found)) == len(found) and not set(found) & set(used):
            break
    return found


def number(value: Optional[float], form: str = "%.3f") -> str:
    """A number in a table; empty for None."""
    return "" if value is None else form % value


class Shown:
    """A result that shows as a title and a table, in a terminal and in a notebook."""

    def _table(self) -> Tuple[str, Row, List[Row]]:
        """Title, head and rows."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, head, rows = self._table()
        return "\n".join([title] + text_table(head, rows))

    def _repr_html_(self) -> str:
        title, head, rows = self._table()
        return table(head, rows, title)
