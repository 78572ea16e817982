"""Poses of topics with any type that carries them, and of tables, as x, y, psi in world_ned."""

import re
from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.reading import containers, places, rows_apart, units, words
from ground.reading.containers import Columns, Topic
from ground.reading.mapping import ANGLES, Poses
from ground.reading.run_settings import Settings
from ground.support.annotations import Array, Flags, Indices
from ground.support.errors import GroundError

STATE = "ground_msgs/State"  # its poses were corrected when they were recorded
# Names of columns that say which body a row of a table is of
BODY = re.compile(
    r"(^|[^a-z])(body|rigid_?body|subject|object|robot|vehicle|craft|child_frame_id|name|agent)$", re.I
)
WITHOUT_AXES = (
    "; or write instead of axes, where headings grow from %s to %s and are clockwise seen from above, "
    '`position: {fields: ["%s", "%s"], ...}`, and where they are counter-clockwise '
    '`position: {fields: ["%s", "-%s"], ...}` and `sign: -1` in heading'
)


@dataclass(frozen=True)
class PoseFields:
    """Where messages of a type have their pose."""

    position: str  #: path of x, y, z; empty: they are at the top
    orientation: str = ""  #: path of the quaternion; empty: the pose is planar
    heading: str = ""  #: path of the heading of a planar pose
    body: str = ""  #: path of the name of what is measured

    def fields(self) -> Tuple[Tuple[str, ...], Tuple[str, ...]]:
        """Paths of the position and of the quaternion or the heading."""
        before = self.position + "." if self.position else ""
        if self.heading:
            return (before + "x", before + "y"), (self.heading,)
        turned = tuple("%s.%s" % (self.orientation, axis) for axis in "xyzw")
        return tuple(before + axis for axis in "xyz"), turned


TRANSFORM = PoseFields("transform.translation", "transform.rotation", body="child_frame_id")
KINDS = {
    "geometry_msgs/PoseStamped": PoseFields("pose.position", "pose.orientation"),
    "geometry_msgs/PoseWithCovarianceStamped": PoseFields("pose.pose.position", "pose.pose.orientation"),
    "nav_msgs/Odometry": PoseFields("pose.pose.position", "pose.pose.orientation", body="child_frame_id"),
    "geometry_msgs/TransformStamped": TRANSFORM,
    "tf2_msgs/TFMessage": TRANSFORM,
    "tf/tfMessage": TRANSFORM,
    "geometry_msgs/Pose": PoseFields("position", "orientation"),
    "geometry_msgs/Transform": PoseFields("translation", "rotation"),
    "geometry_msgs/PointStamped": PoseFields("point", heading="point.z"),
    "geometry_msgs/Pose2D": PoseFields("", heading="theta"),
}
SELDOM = ("geometry_msgs/Pose", "geometry_msgs/Pose2D")  # types without a header
USUAL, LEAP = 0.95, 5.0  # share of the steps of a craft that are usual; least leap [largest of these]
STATIC = "tf_static"  # last name of topics with transforms that do not change
AMBIGUOUS = ("geometry_msgs/PointStamped", "geometry_msgs/Transform")  # no poses unless so named


def rank(name: str, kind: str) -> Optional[int]:
    """How likely a topic whose last name is `name` has the poses: 0 is best; None: not at all."""
    if kind == "geometry_msgs/PoseStamped" and name.endswith("pose"):
        return 0
    if kind == "geometry_msgs/PointStamped" and name in ("pose", "eta"):
        return 1
    if kind == STATE and name == "state":
        return 2
    if kind not in KINDS or kind in AMBIGUOUS or name == STATIC:
        return None
    return 4 if kind in SELDOM else 3


def ranks(topics: Mapping[str, Topic], poses: Poses, without: Sequence[str]) -> Dict[str, int]:
    """Ranks of the topics that may have the poses; `without`: those that are known to be others."""
    found = {}
    for name, topic in topics.items():
        order = rank(name.rsplit("/", 1)[-1], topic.kind)
        if order is not None and topic.count > 0 and name not in without:
            found[name] = order
    of_body = {t: r for t, r in found.items() if poses.body.strip("/") in t.split("/")}
    return of_body or found if poses.body else found


def takes(kind: str, poses: Poses) -> Tuple[str, ...]:
    """Which settings poses of a type take: states were corrected when they were recorded, points are
    planar already, and so are headings unless their axes are given."""
    if kind == STATE:
        return ()
    planar = bool(poses.heading) or not poses.orientation and kind in KINDS and KINDS[kind].heading
    if planar and (poses.axes is None or not poses.heading):
        return ("heading_offset",)
    return ("axes", "heading_offset")


@dataclass(frozen=True)
class PoseTable:
    """Poses as they were measured, and in world_ned."""

    rows: Array  #: (n, 3) x, y [m], psi [rad], world_ned; NaN for invalid ones
    raw: Array  #: (n, 7) position [m] and quaternion x, y, z, w; empty for planar poses
    chosen: Flags  #: which rows of the table are the body's
    absent: Flags  #: which of these have no number of a pose at all

    @property
    def valid(self) -> Flags:
        """Which poses are valid (n,)."""
        return np.asarray(np.isfinite(self.rows).all(axis=1))


def read(
    columns: Columns,
    stamps: Indices,
    where: str,
    kind: str,
    poses: Poses,
    settings: Settings,
    notes: List[str],
) -> PoseTable:
    """The poses of a topic's columns, with stamps (n,) [ns]. where: file and topic, for errors; notes: told
    what was assumed. GroundError when it has no such fields, or poses of several bodies."""
    if kind == STATE:
        eta = containers.values(columns, ["eta[0]", "eta[1]", "eta[2]"], where)
        eta[columns["valid"] == 0] = np.nan
        return PoseTable(eta, np.empty((0, 7)), np.ones(len(eta), bool), np.zeros(len(eta), bool))
    known = KINDS.get(poses.type or kind)
    if poses.position:
        position, rotation = poses.position, poses.orientation or (poses.heading,)
    elif known:
        position, rotation = known.fields()
    else:
        raise GroundError(
            "%s: the pose fields of %s are unknown; name them in a mapping (identify info "
            "--write-mapping drafts one)" % (where, kind)
        )
    chosen = _of_body(columns, _body_column(columns, known), poses.body.strip("/"), where, len(stamps))
    paths = [_of_column(columns, path.lstrip("-"), poses.body) for path in position + rotation]
    numbers = containers.values(columns, paths, where)[chosen]
    count, times = len(position), containers.seconds(stamps[chosen])
    if poses.valid:
        numbers[containers.values(columns, [poses.valid], where)[chosen, 0] == 0] = np.nan
    numbers = np.column_stack([rows_apart.joined(some, times) for some in np.split(numbers, [count], axis=1)])
    untracked = _untracked(numbers[:, :count])
    if untracked.any():
        notes.append("poses of zeros, far from the neighbouring ones, are left out (%d)" % untracked.sum())
        numbers[untracked] = np.nan
    absent = np.isnan(numbers[:, :count]).all(axis=1)
    placed = places.metres(numbers[:, :count], paths[:count], columns, poses, where, notes)
    turned = numbers[:, count:]
    placed *= [-1.0 if path.startswith("-") else 1.0 for path in position]
    turned *= [-1.0 if path.startswith("-") else 1.0 for path in rotation]
    if len(rotation) == 4:
        turned[:, :3] *= poses.heading_sign
    else:
        unit = (
            poses.heading_unit
            or places.unit_of(columns, paths[count:], {"deg"}, "headings are", notes)
            or "rad"
        )
        if unit == "rad":  # as they are: a frame or an offset wraps them
            units.require_radians(where, times, turned[:, 0], paths[count])
        turned *= ANGLES[unit] * poses.heading_sign
    apart, (placed, turned) = turned, rows_apart.together(placed, turned, times, 2 * np.pi)
    if turned is not apart:
        between = int((np.isfinite(turned).all(axis=1) & ~absent).sum())
        notes.append(
            "headings are in separate rows: they are interpolated at %d of %d positions"
            % (between, (~absent).sum())
        )
    rows, raw = _planar(placed, turned, paths[:count], where, stamps[chosen], settings)
    places.subtract_origin(rows, notes)
    return PoseTable(rows, raw, chosen, absent)


def _untracked(position: Array) -> Flags:
    """Which positions (n, k) are the zeros of a body that is lost: the craft would leap from them to the next
    position, as it does not after a reset of the origin, or to them at the end."""
    found = np.zeros(len(position), bool)
    known = np.flatnonzero(np.isfinite(position).all(axis=1))
    is_zero = (position[known] == 0).all(axis=1)
    steps = np.linalg.norm(np.diff(position[known], axis=0), axis=1)
    moves = steps[~is_zero[1:] & ~is_zero[:-1]]
    if not is_zero.any() or not len(moves):
        return found
    leaps = steps > LEAP * np.quantile(moves, USUAL)
    for some in np.split(np.arange(len(known)), np.flatnonzero(np.diff(is_zero)) + 1):
        end = some[-1] if some[-1] < len(leaps) else some[0] - 1
        found[known[some]] = is_zero[some[0]] and leaps[end]
    return found


def _body_column(columns: Columns, known: Optional[PoseFields]) -> str:
    """The column that says which body a row is of; empty: there is none."""
    return known.body if known else next(iter(body_columns(columns)), "")


def body_columns(columns: Columns) -> List[str]:
    """Columns of a table that name the body of each row."""
    texts = [name for name, column in columns.items() if column.dtype == object]
    return [name for name in texts if BODY.search(name) and len(set(map(str, columns[name]))) > 1]


def _of_column(columns: Columns, path: str, body: str) -> str:
    """The path of a field, below the name of the body where the table has several side by side."""
    below = "%s.%s" % (body, path)
    return below if body and below in columns else path


def _planar(
    position: Array, rotation: Array, paths: Sequence[str], where: str, stamps: Indices, settings: Settings
) -> Tuple[Array, Array]:
    """Poses in world_ned (n, 3), and as they were measured (n, 7)."""
    rows, raw = np.full((len(position), 3), np.nan), np.zeros((len(position), 7))
    for change, mapping, some in settings.parts(stamps):
        if rotation.shape[1] == 1 and "axes" not in settings.taken:
            psi = rotation[some, 0] - change.heading_offset
            if change.heading_offset:
                psi = np.angle(np.exp(1j * psi))
            rows[some] = np.column_stack([position[some, :2], psi])
            continue
        axes = [0, 1, 2]
        if position.shape[1] == 2:
            axes = _along(paths, change.axes, change.vertical, rotation.shape[1] == 1, where)
        raw[np.ix_(some, np.array(axes))] = position[some]
        if rotation.shape[1] == 1:  # a turn about the vertical axis
            raw[some, 3 + change.vertical] = np.sin(rotation[some, 0] / 2)
            raw[some, 6] = np.cos(rotation[some, 0] / 2)
        else:
            raw[some, 3:] = rotation[some]
        rows[some] = mapping.to_planar_rows(raw[some, :3].copy(), raw[some, 3:].copy())
    return rows, raw


def _of_body(columns: Columns, path: str, wanted: str, where: str, count: int) -> Flags:
    """Which rows are of the body that was asked for. GroundError when it is not there, or none was asked for
    and there are several."""
    names = columns.get(path)
    if names is None:
        return np.ones(count, bool)
    plain = np.array([str(name).strip("/") for name in names], object)
    known = sorted(set(plain))
    if wanted in known:
        return np.asarray(plain == wanted)
    if wanted and wanted not in where.split("/"):  # else it has chosen the topic
        raise GroundError("%s: no body is named %s; there are %s" % (where, wanted, ", ".join(known)))
    if len(known) > 1:
        raise GroundError(
            "%s: contains the poses of several bodies: %s; choose one with --body" % (where, ", ".join(known))
        )
    return np.ones(count, bool)


def _along(paths: Sequence[str], axes: str, vertical: int, has_heading: bool, where: str) -> List[int]:
    """The horizontal axes that two fields are along: those that they are named after, else in the order x,
    y, z. GroundError where they are named after other ones: either the names or the axes are wrong."""
    horizontal = [axis for axis in range(3) if axis != vertical]
    letters = [words.axis(path)[0] for path in paths]
    if not set(letters) <= {"x", "y", "z"} or letters[0] == letters[1]:
        return horizontal
    named = ["xyz".index(letter) for letter in letters]
    if set(named) != set(horizontal):
        raise GroundError(
            "%s: the axes '%s' need %s, but the position has the fields %s and %s; name the field that is "
            "missing in the mapping, or correct its axes%s"
            % (
                where, axes, " and ".join("xyz"[axis] for axis in horizontal), *paths,
                WITHOUT_AXES % (*paths, *paths, *paths) if has_heading else "",
            )
        )  # fmt: skip
    return named
