"""Shared by the modules of the API: tables, and how results look in a notebook."""

import html
from typing import Iterable, List, Optional, Sequence, Tuple

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
