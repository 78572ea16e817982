"""Tuning by hand in a terminal: all live parameters, changed with the arrow keys."""

import os
from typing import Dict, List, Optional, Sequence, Tuple

import urwid

from ground.nodes.live_parameters import Node, Parameter, Value, range_of, shown
from ground.support.errors import GroundError

PALETTE = [
    ("title", "white,bold", "dark blue"),
    ("node", "black", "light gray"),
    ("chosen", "black", "dark cyan"),
    ("changed", "yellow", ""),
    ("refused", "white", "dark red"),
    ("done", "light green", ""),
]
HELP = " up/down choose   left/right change   +/- tenfold   Enter type   d default   q quit"
STEPS = {"left": -1.0, "right": 1.0, "-": -10.0, "+": 10.0}  # by key


class _Row(urwid.WidgetWrap):  # type: ignore[misc]  # urwid has no types
    """A parameter: name, value, meaning and range."""

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
        text = "%12s" % shown(value)
        self._text.set_text(
            [
                "    %-18s " % p.name,
                ("changed", text) if value != p.default else text,
                "  %s  (%s)" % (p.description, range_of(p)),
            ]
        )

    def keypress(self, size: Tuple[int, ...], key: str) -> Optional[str]:
        """Changes the value by one of urwid's keys; returns keys that it does not use."""
        if key in STEPS:
            value = self.node.values[self.parameter.name]
            self.editor.change(self, self.parameter.nudged(value, STEPS[key]))
        elif key == "d":
            self.editor.change(self, self.parameter.default)
        elif key == "enter":
            self.editor.ask(self)
        else:
            return key
        return None


class Editor:
    """An editor of the parameters of several nodes."""

    def __init__(self, names: Sequence[str]) -> None:
        self._footer = urwid.WidgetPlaceholder(urwid.Text(""))
        self._asked: Optional[_Row] = None
        self._pipe: Optional[int] = None
        self._rows: List[_Row] = []
        listed = []
        for name in names:
            node = Node(name, self._poke)
            listed.append(urwid.AttrMap(urwid.Text(" " + node.name), "node"))
            groups: Dict[str, List[_Row]] = {}
            for p in node.parameters:
                groups.setdefault(p.group, []).append(_Row(self, node, p))
            for group, rows in groups.items():
                listed += [urwid.Text("  " + group), *rows]
                self._rows += rows
        self._frame = urwid.Frame(
            urwid.ListBox(urwid.SimpleFocusListWalker(listed)),
            header=urwid.AttrMap(urwid.Text(HELP), "title"),
            footer=self._footer,
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
        self._footer.original_widget = urwid.Edit("%s = " % row.parameter.name)
        self._frame.focus_position = "footer"

    def _key(self, key: str) -> None:
        if self._asked is None:
            if key in ("q", "Q", "esc"):
                raise urwid.ExitMainLoop()
        elif key in ("enter", "esc"):
            row, text = self._asked, self._footer.original_widget.edit_text
            self._asked = None
            self._frame.focus_position = "body"
            self._say("done", "")
            try:
                if key == "enter":
                    self.change(row, row.parameter.parse(text))
            except GroundError as error:
                self._say("refused", str(error))

    def _say(self, kind: str, text: str) -> None:
        self._footer.original_widget = urwid.Text((kind, " " + text))

    def _poke(self) -> None:
        """Requests a refresh, from the thread in which changes arrive."""
        if self._pipe is not None:
            os.write(self._pipe, b"x")

    def _refresh(self, _: bytes) -> bool:
        for row in self._rows:
            row.refresh()
        return True
