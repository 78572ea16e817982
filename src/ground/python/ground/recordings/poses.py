"""Poses of messages of any type that carries them, and of tables, as x, y, psi in world_ned."""

import math
import re
from dataclasses import dataclass, field
from typing import Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np

from ground.annotations import Array, Flags, Indices, Message, Time
from ground.errors import GroundError
from ground.recordings import fields
from ground.recordings.bag_reader import Topic
from ground.recordings.batches import Batch
from ground.recordings.clocks import Stamp, batch_stamps, stamps
from ground.recordings.mapping import ANGLES, LENGTHS, Poses
from ground.recordings.settings import Settings

STATE = "ground_msgs/State"  # its poses were corrected when they were recorded
TABLE = "table"
WORD = re.compile(r"[A-Za-z]+")
MOST_RAW = 2000  # poses as measured that are kept to judge the axes by

Planar = Tuple[float, float, float]  # x, y [m], psi [rad]
Raw = Tuple[float, ...]  # position, quaternion


@dataclass(frozen=True)
class Kind:
    """Where messages of a type have their pose."""

    position: str  #: path of x, y, z; empty: they are at the top
    orientation: str = ""  #: path of the quaternion; empty: the pose is planar
    heading: str = ""  #: path of the heading of a planar pose
    body: str = ""  #: path of the name of what is measured
    each: str = ""  #: path of a list of items that are poses

    def fields(self) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        """Paths of the position and of the quaternion or the heading."""
        before = self.position + "." if self.position else ""
        if self.heading:
            return (before + "x", before + "y"), (self.heading,)
        return (
            tuple(before + axis for axis in "xyz"),
            tuple("%s.%s" % (self.orientation, axis) for axis in "xyzw"),
        )


KINDS = {
    "geometry_msgs/PoseStamped": Kind("pose.position", "pose.orientation"),
    "geometry_msgs/PoseWithCovarianceStamped": Kind("pose.pose.position", "pose.pose.orientation"),
    "nav_msgs/Odometry": Kind("pose.pose.position", "pose.pose.orientation", "", "child_frame_id"),
    "geometry_msgs/TransformStamped": Kind(
        "transform.translation", "transform.rotation", "", "child_frame_id"
    ),
    "tf2_msgs/TFMessage": Kind(
        "transform.translation", "transform.rotation", "", "child_frame_id", "transforms"
    ),
    "geometry_msgs/Pose": Kind("position", "orientation"),
    "geometry_msgs/Transform": Kind("translation", "rotation"),
    "geometry_msgs/PointStamped": Kind("point", heading="point.z"),
    "geometry_msgs/Pose2D": Kind("", heading="theta"),
}
KINDS["tf/tfMessage"] = KINDS["tf2_msgs/TFMessage"]
# Ranks of the types if no topic is named, behind those whose topics have the usual names.
ANY_NAME = {
    "geometry_msgs/PoseStamped": 3,
    "geometry_msgs/PoseWithCovarianceStamped": 3,
    "nav_msgs/Odometry": 3,
    "geometry_msgs/TransformStamped": 3,
    "tf2_msgs/TFMessage": 3,
    "tf/tfMessage": 3,
    "geometry_msgs/Pose": 4,
    "geometry_msgs/Pose2D": 4,
}


def rank(name: str, kind: str) -> Optional[int]:
    """How likely a topic whose last name is `name` has the poses: 0 is best; None: not at all."""
    if kind == "geometry_msgs/PoseStamped" and name.endswith("pose"):
        return 0
    if kind == "geometry_msgs/PointStamped" and name in ("pose", "eta"):
        return 1
    if kind == STATE and name == "state":
        return 2
    return ANY_NAME.get(kind)


def takes(kind: str, poses: Poses) -> Tuple[str, ...]:
    """Which settings poses of a type take: states were corrected when they were recorded, points are
    planar already, and so are headings unless their axes are given."""
    if kind == STATE:
        return ()
    if poses.heading:
        return ("heading_offset",) if poses.axes is None else ("axes", "heading_offset")
    if not poses.orientation and kind in KINDS and KINDS[kind].heading:
        return ("heading_offset",)
    return ("axes", "heading_offset")


def named(info: Mapping[str, Topic], poses: Poses, where: str) -> str:
    """The topic that a mapping names; GroundError when it is missing or has no poses."""
    topic, kind = poses.topic, info[poses.topic].msg_type
    if poses.type and kind != poses.type:
        raise GroundError("%s: %s has %s, not %s" % (where, topic, kind, poses.type))
    if kind not in KINDS and kind != STATE and not poses.position:
        raise GroundError(
            "%s: %s (%s) has no pose that is known; name its fields in a mapping (identify info "
            "--write-mapping drafts one)" % (where, topic, kind)
        )
    return topic


@dataclass
class PoseReader:
    """Gives the poses of messages of one topic."""

    where: str  # file and topic, for errors
    kind: str
    poses: Poses
    settings: Settings
    raw: List[Raw] = field(default_factory=list)  # some poses as they were measured, lost ones too
    bodies: Set[str] = field(default_factory=set)  # names of what is measured
    _stamp: Stamp = field(init=False)
    _of: Callable[[Message, Time], Optional[Planar]] = field(init=False)

    def __post_init__(self) -> None:
        self._stamp = stamps(self.poses.time, self.where)
        found = KINDS.get(self.kind if not self.poses.type else self.poses.type)
        self._kind = found or Kind("", "")
        self._position, self._rotation = self._paths(found)
        paths = self._position + self._rotation
        self._get = fields.getter([path.lstrip("-") for path in paths])
        self._signs = [-1.0 if path.startswith("-") else 1.0 for path in paths]
        if len(self._rotation) == 4 and self.poses.heading_sign < 0:
            self._signs[-4:-1] = [-sign for sign in self._signs[-4:-1]]
        self._scale = LENGTHS[self.poses.unit] * self.poses.scale
        self._turn = ANGLES[self.poses.heading_unit] * self.poses.heading_sign
        # the axes of the measuring frame that two fields of a position are along, by the vertical one
        self._horizontal: Dict[int, Sequence[int]] = {}
        if len(self._position) == 2 and "axes" in self.settings.taken:
            for change in self.settings.changes:
                self._horizontal[change.vertical] = self._along(change.axes, change.vertical)

    def _along(self, axes: str, vertical: int) -> Sequence[int]:
        """The horizontal axes that two fields are along: those that they are named after, else in the
        order x, y, z. GroundError where they are named after other ones."""
        horizontal = [axis for axis in range(3) if axis != vertical]
        letters = [_axis(path) for path in self._position]
        if "" in letters or letters[0] == letters[1]:
            return horizontal
        named = ["xyz".index(letter) for letter in letters]
        if set(named) != set(horizontal):
            raise GroundError(
                "%s: the axes '%s' need %s, but the position has the fields %s and %s; name the field "
                "that is missing in the mapping, or correct its axes"
                % (
                    self.where,
                    axes,
                    " and ".join("xyz"[axis] for axis in horizontal),
                    *(path.lstrip("-") for path in self._position),
                )
            )
        return named

    def _paths(self, found: Optional[Kind]) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        poses = self.poses
        if poses.position:
            return poses.position, poses.orientation or (poses.heading,)
        if found is None and self.kind != STATE:
            raise GroundError(
                "%s: %s; name the fields of the pose in a mapping (identify info --write-mapping "
                "drafts one)" % (self.where, "its columns are not known to be poses")
            )
        return found.fields() if found else ((), ())

    def __call__(
        self, message: Message, received: Optional[Time]
    ) -> Iterator[Tuple[Time, Optional[Planar]]]:
        """Stamps and poses of a message; None for one that is invalid."""
        if self.kind == STATE:
            x, y, psi = message.eta
            yield message.header.stamp, (x, y, psi) if message.valid else None
            return
        items = fields.getter([self._kind.each])(message)[0] if self._kind.each else [message]
        for item in items:
            if self._kind.body and not self._is_body(str(getattr(item, self._kind.body, ""))):
                continue
            stamp = self._stamp(item, received)
            try:
                values = [sign * float(v) for sign, v in zip(self._signs, self._get(item))]
            except (LookupError, TypeError):
                raise fields.missing(
                    self.where,
                    "a message",
                    [path.lstrip("-") for path in self._position + self._rotation],
                    item,
                )
            except ValueError:
                yield stamp, None
                continue
            yield stamp, self._planar(stamp, values)

    def of_batch(self, batch: Batch) -> Optional[Tuple[Array, Flags]]:
        """Rows of stamp and pose of all messages, and which poses are valid; None where they have to be
        read one by one."""
        stamps = batch_stamps(self.poses.time, batch)
        values = batch.values([path.lstrip("-") for path in self._position + self._rotation])
        if self.kind == STATE or self._kind.each or stamps is None or values is None:
            return None
        if self._horizontal:
            return None
        if self._kind.body:
            bodies = [getattr(group.sample, self._kind.body, "") for group in batch.groups]
            if not all([self._is_body(str(body)) for body in bodies]):
                return None
        values = values * self._signs
        count = len(self._position)
        position = np.zeros((len(values), 3))
        position[:, :count] = self._scale * values[:, :count]
        poses = self._planar_rows(stamps[1], position, values[:, count:])
        if poses is None:
            return None
        return np.column_stack([stamps[0], poses[0]]), poses[1]

    def _planar_rows(
        self, stamps: Indices, position: Array, rotation: Array
    ) -> Optional[Tuple[Array, Flags]]:
        """Poses x, y, psi at stamps [ns], and which are valid; None where they have to be converted one by
        one."""
        if rotation.shape[1] == 1:
            if "axes" in self.settings.taken or any(self.settings.values("heading_offset") or ()):
                return None
            poses = np.column_stack([position[:, :2], self._turn * rotation])
            return poses, np.ones(len(poses), bool)
        self.raw += [tuple(row) for row in np.hstack([position, rotation])[:MOST_RAW].tolist()]
        poses = np.empty_like(position)
        for mapping, rows in self.settings.parts(stamps):
            poses[rows] = mapping.to_planar_rows(position[rows], rotation[rows])
        return poses, ~np.isnan(poses).any(axis=1)

    def _is_body(self, name: str) -> bool:
        self.bodies.add(name)
        return not self.poses.body or name.strip("/") == self.poses.body.strip("/")

    def _planar(self, stamp: Time, values: Sequence[float]) -> Optional[Planar]:
        count = len(self._position)
        position = [self._scale * value for value in values[:count]]
        if len(values) - count == 1:
            heading = self._turn * values[-1]
            if "axes" not in self.settings.taken:
                psi = self.settings.heading(stamp, heading)
                return position[0], position[1], psi
            rotation = _about(self.settings.vertical(stamp), heading)
        else:
            rotation = tuple(values[count:])
        if count == 2:
            placed = [0.0] * 3
            for axis, value in zip(self._horizontal[self.settings.vertical(stamp)], position):
                placed[axis] = value
            position = placed
        if len(self.raw) < MOST_RAW:
            self.raw.append((*position, *rotation))
        planar = self.settings.mapping(stamp).to_planar(position, rotation)
        return None if planar is None else (planar[0], planar[1], planar[2])

    def finish(self) -> None:
        """GroundError when the body that was asked for is not there, or none was and there are
        several."""
        known = sorted(self.bodies)
        wanted = self.poses.body.strip("/")
        if not known or wanted in [name.strip("/") for name in known]:
            return
        if wanted and self._kind.body:
            if wanted in self.where.split("/"):  # it has chosen the topic
                return
            raise GroundError(
                "%s: no body is named %s; there are %s" % (self.where, wanted, ", ".join(known))
            )
        if len(known) > 1:
            raise GroundError(
                "%s: it has the poses of several bodies: %s; choose one by --body"
                % (self.where, ", ".join(known))
            )


def _axis(path: str) -> str:
    """The axis that a field is named after, "x" for "position.x", "px" and "X [mm]"; empty: none."""
    words: List[str] = WORD.findall(path.rsplit(".", 1)[-1])
    alone = [word for word in words if word in "xyzXYZ" and len(word) == 1]
    last = (alone or words or [""])[0][-1:].lower()
    return last if last and last in "xyz" else ""


def _about(axis: int, angle: float) -> Tuple[float, ...]:
    """The quaternion x, y, z, w of a turn about x, y or z (0, 1, 2)."""
    turned = [0.0, 0.0, 0.0, math.cos(angle / 2)]
    turned[axis] = math.sin(angle / 2)
    return tuple(turned)


def candidates(info: Mapping[str, Topic], poses: Poses, without: Sequence[str]) -> Dict[str, int]:
    """Ranks of the topics that may have the poses; `without`: those that are known to be others."""
    found = {}
    for topic, entry in info.items():
        order = rank(topic.rsplit("/", 1)[-1], entry.msg_type)
        if order is not None and entry.message_count > 0 and topic not in without:
            found[topic] = order
    if poses.body:
        of_body = {t: r for t, r in found.items() if poses.body.strip("/") in t.split("/")}
        return of_body or found
    return found
