"""Markers of a discovery for rviz, beside the room: a bar for each belief, and the error of each model
by flight.

Seen from above, x of world_ned upwards and y to the right, the beliefs are on the right of the room,
the errors on its left, below the legend, and what happens is over it.
"""

import math
import textwrap
from typing import List, Sequence, Tuple

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ground import _core
from ground.annotations import Array, Message
from ground.discovery.story import ABSENT, HIDDEN, OPEN, PRESENT, SLIGHT
from ground.reports import appearance

GAP = 0.35  # between the room and the markers [m]
TEXT, TITLE = 0.11, 0.14  # height of letters [m]
# Widths of letters, by their height; all others have USUAL
NARROW, NARROW_WIDTH = set("fijlrt.,:;()'|"), 0.22
WIDE, WIDE_WIDTH = set("mw"), 0.65
USUAL = 0.46
ROW, MOST_ROWS = 0.165, 35  # height of a row of beliefs [m]; more rows are closer together
ABOVE_ROOM = 0.85  # how far the markers reach over the room's upper wall [m]
NAME = 1.25  # space for the name of an effect [m]
FULL = 0.95  # length of the bar of a certain effect [m]
WIDTH, HEIGHT = 2.2, 1.4  # the diagram's [m]
LINE = 0.03  # width of a curve [m]
MAX_LINES = 5  # lines of text over the room
LETTERS = 62  # longest line over the room
HEADROOM = 1.1  # end of the axis, relative to the largest error
BACK, FRONT = -0.02, -0.03  # z of what is behind and in front, above the floor, world_ned [m]
COLORS = {
    PRESENT: appearance.GOOD,
    HIDDEN: appearance.LINES,
    SLIGHT: appearance.LESS,
    ABSENT: appearance.LESS,
}
OPEN_COLOR = appearance.MISSING


class _Sheet:
    """Markers in a frame whose axes point right and up, with its origin at a place in world_ned."""

    def __init__(self, array: Message, group: str, x: float, y: float) -> None:
        self._array, self._group, self._x, self._y = array, group, x, y
        self._number = 0

    def point(self, right: float, up: float, z: float = FRONT) -> Message:
        """A point of the sheet in world_ned."""
        return Point(self._x + up, self._y + right, z)

    def add(self, kind: int, color: str, opacity: float = 1.0) -> Message:
        """Another marker."""
        marker = Marker()
        marker.header.frame_id = "world_ned"
        marker.ns, marker.id, marker.type = self._group, self._number, kind
        marker.pose.orientation.w = 1.0
        marker.color = _rgba(color, opacity)
        self._number += 1
        self._array.markers.append(marker)
        return marker

    def text(
        self, text: str, right: float, up: float, height: float = TEXT, color: str = appearance.TEXT
    ) -> None:
        """A line of text that begins at a point; rviz centres it, so its width is estimated."""
        marker = self.add(Marker.TEXT_VIEW_FACING, color)
        marker.text = text
        marker.scale.z = height
        marker.pose.position = self.point(right + 0.5 * height * _width(text), up)

    def bar(
        self, length: float, right: float, up: float, height: float, color: str, z: float = FRONT
    ) -> None:
        """A bar to the right of a point at half of its height."""
        marker = self.add(Marker.CUBE, color)
        marker.pose.position = self.point(right + 0.5 * length, up, z)
        marker.scale.x, marker.scale.y, marker.scale.z = height, max(length, 1e-3), 1e-3

    def line(self, points: Sequence[Tuple[float, float]], color: str, width: float) -> None:
        """A line through points; a point alone has no line."""
        if len(points) > 1:
            marker = self.add(Marker.LINE_STRIP, color)
            marker.scale.x = width
            marker.points = [self.point(*p) for p in points]

    def dots(self, points: Sequence[Tuple[float, float]], color: str) -> None:
        """A round mark at each point."""
        if points:
            marker = self.add(Marker.SPHERE_LIST, color)
            marker.scale.x = marker.scale.y = marker.scale.z = 3 * LINE
            marker.points = [self.point(*p) for p in points]


def markers(status: Message, room: _core.RoomPlan) -> Message:
    """The MarkerArray of a DiscoveryStatus; it replaces an earlier one."""
    array = MarkerArray()
    none = Marker(action=Marker.DELETEALL)
    none.header.frame_id = "world_ned"
    array.markers.append(none)
    corners = np.array(room.corners)
    low, high = corners.min(axis=0), corners.max(axis=0)
    top = high[0] + ABOVE_ROOM
    _draw_activity(_Sheet(array, "activity", top, low[1]), status)
    _draw_beliefs(_Sheet(array, "beliefs", top, high[1] + GAP), status)
    middle = 0.5 * (low[0] + high[0])
    _draw_errors(_Sheet(array, "errors", middle, low[1] - GAP - WIDTH), status)
    return array


def _draw_activity(sheet: _Sheet, status: Message) -> None:
    """What happens now, over the room."""
    told = status.reason if status.ended else status.activity
    found = ", ".join(status.effects) if status.effects else "nothing yet"
    lines = ["%.0f of %.0f s of flight; found: %s" % (status.flown, status.budget, found)]
    if status.verdict:
        lines[0] += " (%s)" % status.verdict
    lines += textwrap.wrap(told, LETTERS, max_lines=MAX_LINES - 1, placeholder=" ...")
    for number, line in enumerate(lines):
        sheet.text(line, 0.0, -1.3 * TITLE * number, TITLE if number == 0 else TEXT)


def _draw_beliefs(sheet: _Sheet, status: Message) -> None:
    """Names and bars, the most probable effect first."""
    if not status.belief_effects:
        return
    sheet.text("probability that it acts and matters", 0.0, 0.0, TITLE)
    rows = sorted(
        zip(status.beliefs, status.belief_effects, status.belief_states),
        key=lambda row: (-row[0], row[1]),
    )
    height = ROW * min(1.0, MOST_ROWS / len(rows))
    for number, (probability, effect, state) in enumerate(rows, 1):
        up = -TITLE - number * height
        color = appearance.TEXT if state in (PRESENT, OPEN) else appearance.LESS
        sheet.text(effect, 0.0, up, TEXT, color)
        sheet.bar(FULL, NAME, up, 0.6 * height, appearance.FAINT, BACK)
        sheet.bar(FULL * probability, NAME, up, 0.6 * height, COLORS.get(state, OPEN_COLOR))


def _draw_errors(sheet: _Sheet, status: Message) -> None:
    """A diagram of the error of each model on each flight, and of what noise and disturbance leave."""
    count = status.flights
    if not count:
        return
    errors = np.array(status.errors, float).reshape(len(status.models), count)
    rows = [(label, appearance.model_color(i), errors[i]) for i, label in enumerate(status.models)]
    rows.append(("noise and pushes", appearance.FLOOR, np.array(status.floors, float)))
    values = np.concatenate([row[2] for row in rows])
    most = float(np.max(values, initial=0.0, where=np.isfinite(values)))
    sheet.text("error of each model by flight", 0.0, 0.0, TITLE)
    bottom = -HEIGHT - TITLE
    sheet.line([(0.0, bottom + HEIGHT), (0.0, bottom), (WIDTH, bottom)], appearance.LESS, 0.01)
    places = (np.arange(count) + 0.5) * WIDTH / count
    for number, place in enumerate(places, 1):
        sheet.text(str(number), place - 0.5 * USUAL * TEXT, bottom - TEXT, TEXT)
    if most > 0:
        sheet.text("%.2g" % most, 0.05, bottom + HEIGHT, TEXT)
    for number, (label, color, row) in enumerate(rows):
        points = _points(places, row, bottom, HEADROOM * most)
        sheet.line(points, color, LINE)
        sheet.dots(points, color)
        line, column = divmod(number, 2)
        sheet.text(label, column * 0.5 * WIDTH, bottom - (2.5 + 1.4 * line) * TEXT, TEXT, color)


def _points(places: Array, values: Array, bottom: float, top: float) -> List[Tuple[float, float]]:
    """Points (right, up) of a curve, where its values are finite."""
    return [
        (float(right), bottom + HEIGHT * value / top)
        for right, value in zip(places, values)
        if math.isfinite(value)
    ]


def _width(text: str) -> float:
    """Estimated width of a text, by the height of its letters."""
    widths = (
        NARROW_WIDTH if letter in NARROW else WIDE_WIDTH if letter in WIDE else USUAL
        for letter in text
    )
    return sum(widths)


def _rgba(color: str, opacity: float) -> Message:
    """A colour "#rrggbb"."""
    parts = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return ColorRGBA(*parts, opacity)
