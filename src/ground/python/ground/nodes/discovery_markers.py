"""Markers of a discovery for rviz: what happens over the room, and the belief in each effect on its right.

Seen from above, x of world_ned is upwards and y to the right.
"""

import textwrap
from typing import List

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ground import _core
from ground.discovery.story import OPEN, PRESENT
from ground.reports import appearance
from ground.support.annotations import Message

GAP = 0.35  # between the room and the markers [m]
ABOVE_ROOM = 0.85  # how far the markers reach over the room's upper wall [m]
LETTER = 0.11  # height of letters [m]
WIDTH = 0.46  # usual width of a letter, by its height
ROW = 0.165  # height of a row [m]
MOST_ROWS = 35  # most beliefs that are shown
NAME, FULL = 1.25, 0.95  # length of the name of an effect, and of the bar of a certain one [m]
LETTERS = 62  # longest line over the room
HEIGHT = -0.03  # z of the markers, above the floor, world_ned [m]
COLORS = {PRESENT: appearance.GOOD, OPEN: appearance.MISSING}


def markers(status: Message, room: _core.RoomPlan) -> Message:
    """The MarkerArray of a DiscoveryStatus; it replaces an earlier one."""
    array = MarkerArray()
    none = Marker(action=Marker.DELETEALL)
    none.header.frame_id = "world_ned"
    array.markers.append(none)
    corners = np.array(room.corners)
    left, right = corners[:, 1].min(), corners[:, 1].max() + GAP
    top = corners[:, 0].max() + ABOVE_ROOM
    for row, line in enumerate(_lines(status)):
        _add_text(array, line, left, top - row * ROW)
    beliefs = sorted(zip(status.beliefs, status.belief_effects, status.belief_states), reverse=True)
    if beliefs:
        _add_text(array, "probability that it acts and matters", right, top)
    for row, (probability, effect, state) in enumerate(beliefs[:MOST_ROWS], 1):
        x = top - row * ROW
        _add_text(array, effect, right, x)
        length = max(FULL * probability, 1e-3)
        bar = _add(array, Marker.CUBE, COLORS.get(state, appearance.LESS))
        bar.pose.position = Point(x, right + NAME + 0.5 * length, HEIGHT)
        bar.scale.x, bar.scale.y, bar.scale.z = 0.6 * ROW, length, 1e-3
    return array


def _lines(status: Message) -> List[str]:
    """What happens now."""
    found = ", ".join(status.effects) or "nothing yet"
    lines = ["%.0f of %.0f s of flight; found: %s" % (status.flown, status.budget, found)]
    told = status.reason if status.ended else status.activity
    return lines + textwrap.wrap(told, LETTERS, max_lines=4, placeholder=" ...")


def _add(array: Message, kind: int, color: str) -> Message:
    marker = Marker(type=kind, id=len(array.markers), ns="discovery")
    marker.header.frame_id = "world_ned"
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(*(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)), 1.0)
    array.markers.append(marker)
    return marker


def _add_text(array: Message, text: str, y: float, x: float) -> None:
    """A line of text that begins at a place; rviz centres it, so its width is estimated."""
    marker = _add(array, Marker.TEXT_VIEW_FACING, appearance.TEXT)
    marker.text, marker.scale.z = text, LETTER
    marker.pose.position = Point(x, y + 0.5 * LETTER * WIDTH * len(text), HEIGHT)
