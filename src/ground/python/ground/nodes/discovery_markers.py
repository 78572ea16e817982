"""Markers of a discovery for rviz: what happens, and the belief in each effect on the right.

Seen from above, x of world_ned is upwards and y to the right. The markers are over and beside the room, or
in a view that follows the craft.
"""

import textwrap
from typing import List

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ground import _core
from ground.discovery.story import OPEN, PRESENT
from ground.reports import appearance
from ground.support.annotations import Message

GAP = 0.35  # between the room and the markers [m]
ABOVE_ROOM = 0.85  # how far the markers reach over the room's upper wall [m]
LETTER = 0.11  # height of letters [m]
ROW = 1.5  # height of a row, in letters
NEAR = 132 / 420  # size of what the view near the craft shows, by the size of a room
FOLLOWING = (0.9, -0.15, 0.85)  # in the view that follows: top, left edges of what happens and of beliefs [m]
MOST_ROWS = 35  # most beliefs that are shown
LETTERS = 62  # longest line of what happens
HEIGHT = -0.03  # z of the markers, above the floor [m]
COLORS = {PRESENT: appearance.GOOD, OPEN: appearance.BUSY}


def markers(status: Message, room: _core.RoomPlan, follows: bool) -> Message:
    """The MarkerArray of a DiscoveryStatus; it replaces an earlier one. follows: whether the view follows the
    craft."""
    array = MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
    array.markers[0].header.frame_id = "world_ned"
    beliefs = sorted(zip(status.beliefs, status.belief_effects, status.belief_states), reverse=True)
    title = [("probability that it acts and matters", appearance.TEXT)] if beliefs else []
    listed = [
        ("%3.0f%% %s" % (100 * probability, effect), COLORS.get(state, appearance.LESS))
        for probability, effect, state in beliefs[:MOST_ROWS]
    ]
    now = [(line, appearance.TEXT) for line in _lines(status)]
    corners = np.array(room.corners)
    over, beside = corners.max(axis=0) + (ABOVE_ROOM, GAP)
    top, left, right = FOLLOWING if follows else (over, corners[:, 1].min(), beside)
    letter = LETTER * (NEAR if follows else 1.0)
    for lines, y in ((now, left), (title + listed, right)):
        rows = [(text, color, letter * _core.text_width(text)) for text, color in lines]
        if rows:
            width = max(width for _, _, width in rows)
            panel = _marker(array, Marker.CUBE, "#ffffff", follows)
            panel.scale = Vector3(ROW * letter * len(rows), width, 0.001)
            panel.pose.position = Point(top - ROW * letter * (len(rows) - 1) / 2, y + width / 2, HEIGHT / 2)
        for row, (text, color, width) in enumerate(rows):
            marker = _marker(array, Marker.TEXT_VIEW_FACING, color, follows)
            marker.text, marker.scale.z = text, letter
            # rviz centres a text.
            marker.pose.position = Point(top - ROW * letter * row, y + width / 2, HEIGHT)
    return array


def _marker(array: Message, kind: int, color: str, follows: bool) -> Message:
    """A further marker of an array."""
    marker = Marker(type=kind, id=len(array.markers), ns="discovery", frame_locked=follows)
    marker.header.frame_id = "view" if follows else "world_ned"
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(*(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)), 1.0)
    array.markers.append(marker)
    return marker


def _lines(status: Message) -> List[str]:
    """What happens now."""
    found = ", ".join(status.effects) or "nothing yet"
    lines = ["%.0f of %.0f s of flight; found: %s" % (status.flown, status.budget, found)]
    told = status.reason if status.ended else status.activity
    return lines + textwrap.wrap(told, LETTERS, max_lines=4, placeholder=" ...")
