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
ROW = 0.165  # height of a row [m]
MOST_ROWS = 35  # most beliefs that are shown
LETTERS = 62  # longest line over the room
HEIGHT = -0.03  # z of the markers, above the floor, world_ned [m]
COLORS = {PRESENT: appearance.GOOD, OPEN: appearance.BUSY}


def markers(status: Message, room: _core.RoomPlan) -> Message:
    """The MarkerArray of a DiscoveryStatus; it replaces an earlier one."""
    array = MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
    array.markers[0].header.frame_id = "world_ned"
    corners = np.array(room.corners)
    top = corners[:, 0].max() + ABOVE_ROOM
    beliefs = sorted(zip(status.beliefs, status.belief_effects, status.belief_states), reverse=True)
    title = [("probability that it acts and matters", appearance.TEXT)] if beliefs else []
    listed = [
        ("%3.0f%% %s" % (100 * probability, effect), COLORS.get(state, appearance.LESS))
        for probability, effect, state in beliefs[:MOST_ROWS]
    ]
    now = [(line, appearance.TEXT) for line in _lines(status)]
    for lines, y in ((now, corners[:, 1].min()), (title + listed, corners[:, 1].max() + GAP)):
        for row, (text, color) in enumerate(lines):
            marker = Marker(type=Marker.TEXT_VIEW_FACING, id=len(array.markers), ns="discovery", text=text)
            marker.header.frame_id = "world_ned"
            marker.pose.orientation.w, marker.scale.z = 1.0, LETTER
            marker.color = ColorRGBA(*(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)), 1.0)
            # rviz centres a text.
            marker.pose.position = Point(top - row * ROW, y + 0.5 * LETTER * _core.text_width(text), HEIGHT)
            array.markers.append(marker)
    return array


def _lines(status: Message) -> List[str]:
    """What happens now."""
    found = ", ".join(status.effects) or "nothing yet"
    lines = ["%.0f of %.0f s of flight; found: %s" % (status.flown, status.budget, found)]
    told = status.reason if status.ended else status.activity
    return lines + textwrap.wrap(told, LETTERS, max_lines=4, placeholder=" ...")
