"""Tuning by hand in a terminal: all live parameters, changed with the arrow keys."""

import math
import os
from typing import Any, Optional, Sequence, Tuple

import urwid

from ground.errors import GroundError
from ground.nodes import live_parameters
from ground.nodes.live_parameters import Node, Parameter, Value, shown

PALETTE = [
    ("title", "white,bold", "dark blue"),
    ("node", "black", "light gray"),
    ("group", "light cyan", ""),
    ("chosen", "black", "dark cyan"),
    ("changed", "yellow", ""),
    ("refused", "white", "dark red"),
    ("done", "light green", ""),
]
HELP = " up/down choose   left/right change   +/- tenfold   Enter type   d default   q quit"
BAR = 20  # characters of a bar


class _Row(urwid.WidgetWrap):  # type: ignore[misc]  # urwid has no types
    """A parameter: name, value, its place in the range, and its meaning."""

    def __init__(self, editor: "Editor", node: Node, parameter: Parameter) -> None:
        self.editor, self.node, self.parameter = editor, node, parameter
        self._text = urwid.Text("", wrap="clip")
        super().__init__(urwid.AttrMap(self._text, None, "chosen"))
        self.refresh()

    def selectable(self) -> bool:
        """Tells urwid that rows can be chosen."""
        return True

    def refresh(self) -> None:
        """Shows the value that the node has now."""
        p, value = self.parameter, self.node.values[self.parameter.name]
        mark = "changed" if value != p.default else None
        self._text.set_text(
            [
                "    %-18s " % p.name,
                (mark, "%12s" % shown(value)) if mark else "%12s" % shown(value),
                "  %s  %s  (%s)" % (_bar(p, value), p.description, live_parameters.range_of(p)),
            ]
        )

    def keypress(self, size: Tuple[int, ...], key: str) -> Optional[str]:
        """Changes the value by one of urwid's keys; returns keys that it does not use."""
        p, value = self.parameter, self.node.values[self.parameter.name]
        if key in ("left", "right"):
            self.editor.change(self, p.nudged(value, key == "right"))
        elif key in ("-", "+"):
            self.editor.change(self, p.nudged(value, key == "+", 10.0))
        elif key == "d":
            self.editor.change(self, p.default)
        elif key == "enter":
            self.editor.ask(self)
        else:
            return key
        return None


def _bar(parameter: Parameter, value: Any) -> str:
    if parameter.kind not in ("double", "int") or not parameter.upper > parameter.lower:
        return " " * BAR
    low, high = parameter.lower, parameter.upper
    if low > 0 and high > 1000 * low:
        low, high, value = math.log(low), math.log(high), math.log(max(value, low))
    part = (value - low) / (high - low)
    at = int(round(max(0.0, min(1.0, part)) * (BAR - 1)))
    return "-" * at + "|" + "-" * (BAR - 1 - at)


class Editor:
    """An editor of the parameters of several nodes."""

    def __init__(self, names: Sequence[str]) -> None:
        self._message = urwid.Text("")
        self._rows, self._pipe = [], None
        self._nodes = [live_parameters.Node(name, self._poke) for name in names]
        listed = []
        for node in self._nodes:
            listed.append(urwid.AttrMap(urwid.Text(" " + node.name), "node"))
            group = None
            for p in node.parameters:
                if p.group != group:
                    group = p.group
                    listed.append(urwid.AttrMap(urwid.Text("  " + group), "group"))
                self._rows.append(_Row(self, node, p))
                listed.append(self._rows[-1])
        self._prompt = urwid.Edit()
        self._asked: Optional[_Row] = None
        self._frame = urwid.Frame(
            urwid.ListBox(urwid.SimpleFocusListWalker(listed)),
            header=urwid.AttrMap(urwid.Text(HELP), "title"),
            footer=self._message,
        )
        self._loop = urwid.MainLoop(self._frame, PALETTE, unhandled_input=self._key)
        self._pipe = self._loop.watch_pipe(self._refresh)

    def run(self) -> None:
        """Shows the window until the user ends it."""
        self._loop.run()

    def change(self, row: _Row, value: Value) -> None:
        """Sets a parameter and shows the result."""
        name = row.parameter.name
        try:
            row.node.set({name: value})
            self._say("done", "%s %s = %s" % (row.node.name, name, shown(value)))
        except GroundError as error:
            self._say("refused", str(error))
        self._refresh(b"")

    def ask(self, row: _Row) -> None:
        """Asks for a value of the row's parameter."""
        self._asked = row
        self._prompt = urwid.Edit("%s = " % row.parameter.name)
        self._frame.footer = self._prompt
        self._frame.focus_position = "footer"

    def _key(self, key: str) -> None:
        if self._asked:
            if key in ("enter", "esc"):
                row, self._asked = self._asked, None
                self._frame.footer = self._message
                self._frame.focus_position = "body"
                if key == "enter":
                    try:
                        self.change(row, row.parameter.parse(self._prompt.edit_text))
                    except GroundError as error:
                        self._say("refused", str(error))
        elif key in ("q", "Q", "esc"):
            raise urwid.ExitMainLoop()

    def _say(self, kind: str, text: str) -> None:
        self._message.set_text((kind, " " + text))

    def _poke(self) -> None:
        """Requests a refresh, from the thread in which changes arrive."""
        if self._pipe is not None:
            os.write(self._pipe, b"x")

    def _refresh(self, _: bytes) -> bool:
        for row in self._rows:
            row.refresh()
        return True
