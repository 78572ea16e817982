"""Shapes of Foxglove's scenes, in frames whose z points down: lines, arrows, cylinders, tiles and texts."""

import math
from typing import Any, Iterable, Sequence, Tuple

from foxglove import messages as fx

from ground import _core

Point = Tuple[float, float]  # x, y [m]
WORLD, WORLD_NED, CRAFT = "world", "world_ned", "hovercraft"  # frames, as tf has them
LETTER = 0.15  # height of letters [m]


def color(text: str, opacity: float = 1.0, darker: float = 1.0) -> Any:
    """A colour "#rrggbb", times `darker`."""
    red, green, blue = (darker * c for c in _channels(text))
    return fx.Color(r=red, g=green, b=blue, a=opacity)


def scale_color(value: float, opacity: float) -> Any:
    """Colour of a value, 0 (small) to 1 (large and above)."""
    steps = _core.palette["scale"]
    place = min(max(value, 0.0), 1.0) * (len(steps) - 1)
    below = min(int(place), len(steps) - 2)
    ends = zip(_channels(steps[below]), _channels(steps[below + 1]))
    red, green, blue = (low + (place - below) * (high - low) for low, high in ends)
    return fx.Color(r=red, g=green, b=blue, a=opacity)


def _channels(text: str) -> Tuple[float, ...]:
    return tuple(int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))


def timestamp(time: int) -> Any:
    """A time [ns] as Foxglove has it."""
    return fx.Timestamp(*divmod(time, 1_000_000_000))


def turned(psi: float) -> Any:
    """The rotation by a heading [rad]."""
    return fx.Quaternion(x=0.0, y=0.0, z=math.sin(psi / 2), w=math.cos(psi / 2))


def pose(x: float, y: float, above: float, psi: float = 0.0) -> Any:
    """A pose so high above the floor [m], with a heading [rad]."""
    return fx.Pose(position=fx.Vector3(x=x, y=y, z=-above), orientation=turned(psi))


def line(points: Iterable[Point], above: float, width: float, shade: Any, closed: bool = False) -> Any:
    """A line through points, so high above the floor and so wide [m]."""
    kinds = fx.LinePrimitiveLineType
    return fx.LinePrimitive(
        type=kinds.LineLoop if closed else kinds.LineStrip,
        pose=pose(0.0, 0.0, 0.0),
        thickness=width,
        points=[fx.Point3(x=x, y=y, z=-above) for x, y in points],
        color=shade,
    )


def arrow(start: Point, along: Point, above: float, width: float, shade: Any) -> Any:
    """An arrow from a point along a vector [m], with a shaft so wide [m]."""
    length = math.hypot(*along)
    head = min(0.4 * length, 3 * width)
    return fx.ArrowPrimitive(
        pose=pose(start[0], start[1], above, math.atan2(along[1], along[0])),
        shaft_length=length - head,
        shaft_diameter=width,
        head_length=head,
        head_diameter=2.3 * width,
        color=shade,
    )


def cylinder(place: Point, above: float, size: Sequence[float], shade: Any) -> Any:
    """An upright cylinder of some length, width and height [m]."""
    wide = fx.Vector3(x=size[0], y=size[1], z=size[2])
    return fx.CylinderPrimitive(
        pose=pose(place[0], place[1], above), size=wide, bottom_scale=1.0, top_scale=1.0, color=shade
    )


def tile(place: Point, side: float, shade: Any) -> Any:
    """A square on the floor, with sides of some length [m]."""
    return fx.CubePrimitive(pose=pose(*place, 0.0), size=fx.Vector3(x=side, y=side, z=0.002), color=shade)


def text(place: Point, words: str, shade: Any) -> Any:
    """A line of text that faces the viewer."""
    return fx.TextPrimitive(
        pose=pose(*place, 0.05), billboard=True, font_size=LETTER, color=shade, text=words
    )


def entity(name: str, frame: str, time: int, **shapes: Any) -> Any:
    """A thing of a scene, in a frame; it moves with the frame. shapes: lists of primitives."""
    return fx.SceneEntity(id=name, frame_id=frame, timestamp=timestamp(time), frame_locked=True, **shapes)


def frame(parent: str, child: str, time: int, x: float, y: float, rotation: Any) -> Any:
    """Where a frame is in another one [m]."""
    return fx.FrameTransform(
        timestamp=timestamp(time),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=fx.Vector3(x=x, y=y, z=0.0),
        rotation=rotation,
    )


OVER = fx.Quaternion(x=1.0, y=0.0, z=0.0, w=0.0)  # a half turn about x: z points down
