"""Poses of a body that static transforms fix to a measured frame: tf_static, or constant ones of tf."""

from typing import Any, Dict, List, Set, Tuple

import numpy as np

from ground.recordings import poses
from ground.recordings.containers import Columns, Container
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

Pose = Tuple[Array, Any]  # position (..., 3) and Rotation of a frame in another one
Fixed = Dict[str, Dict[str, Pose]]  # for each frame, its poses in the frames that it is fixed to


def of_body(source: Container, topic: str, columns: Columns, body: str, notes: List[str]) -> Columns:
    """The columns of a topic with poses; where the body is fixed to a measured frame, as poses of the body. body:
    empty: what is measured; notes: receives what was assumed. GroundError when no frame has the name."""
    kind, body = poses.KINDS.get(source.topics[topic].kind), body.strip("/")
    if kind is None or not kind.orientation or not (body or kind is poses.TRANSFORM):
        return columns
    names = _frames(columns, kind.body) if kind.body in columns else np.array(topic.split("/"), object)
    fixed: Fixed = {}
    still = _add(fixed, columns, False) if kind is poses.TRANSFORM else np.zeros(len(names), bool)
    for other in source.of_kind("tf2_msgs/TFMessage") + source.of_kind("tf/tfMessage"):
        if other != topic:
            _add(fixed, source.table(other), other.endswith(poses.STATIC))
    measured = set(names[~still])
    ways = {frame: _way(fixed, frame, measured) for frame in sorted(set(fixed) - measured)}
    known = ", ".join("%s (fixed to %s)" % (frame, way[0]) for frame, way in ways.items() if way[0])
    parent, pose = ways.get(body, ("", None))
    if pose is not None and parent:
        text = "%s is fixed to %s by static transforms: %.3g m away, turned by %.3g deg"
        notes.append(text % (body, parent, np.linalg.norm(pose[0]), np.degrees(pose[1].magnitude())))
        return _moved(columns, kind, (names == parent) & ~still if kind.body in columns else slice(None), body, pose)
    if known and not body:
        notes.append("--body also takes the poses of frames that static transforms fix: " + known)
    elif known and body not in {*names, *topic.split("/")}:
        there = ", ".join([*sorted(measured), known])
        raise GroundError("%s: %s: no body is named %s; there are %s" % (source.path, topic, body, there))
    return columns


def _frames(columns: Columns, path: str) -> Array:
    """Names of frames (n,), without slashes at their ends."""
    return np.array([str(name).strip("/") for name in columns[path]], object)


def _poses(columns: Columns, kind: poses.Kind) -> Tuple[Array, Array]:
    position, rotation = (np.column_stack([columns[path] for path in paths]) for paths in kind.fields())
    return position, rotation


def _add(fixed: Fixed, columns: Columns, is_static: bool) -> Flags:
    """Adds the transforms that never change, or of a static topic the last ones; which rows (n,) they are."""
    parents, children = (_frames(columns, path) for path in ("header.frame_id", "child_frame_id"))
    position, rotation = _poses(columns, poses.TRANSFORM)
    rows, still = np.column_stack([position, rotation]), np.zeros(len(parents), bool)
    for parent, child in set(zip(parents, children)):
        some = (parents == parent) & (children == child)
        if is_static or (rows[some] == rows[some][0]).all():
            still |= some
            place, turn = position[some][-1], _rotation(rotation[some][-1])
            fixed.setdefault(child, {})[parent] = place, turn
            fixed.setdefault(parent, {})[child] = -turn.inv().apply(place), turn.inv()
    return still


def _rotation(quaternions: Array) -> Any:
    """The Rotation of quaternions (..., 4); none of a quaternion that is no rotation."""
    from scipy.spatial.transform import Rotation

    valid = (quaternions**2).sum(axis=-1, keepdims=True) > 0
    return Rotation.from_quat(np.where(valid, quaternions, [0.0, 0.0, 0.0, 1.0]))


def _together(outer: Pose, inner: Pose) -> Pose:
    """The pose in the outer frame of what has a pose in a frame that has a pose there."""
    return outer[0] + outer[1].apply(inner[0]), outer[1] * inner[1]


def _way(fixed: Fixed, body: str, measured: Set[str]) -> Tuple[str, Pose]:
    """The nearest measured frame that a body is fixed to, and its pose there; empty: there is none."""
    reached: Dict[str, Pose] = {body: (np.zeros(3), _rotation(np.zeros(4)))}
    frames = [body]
    for frame in frames:
        if frame in measured:
            return frame, reached[frame]
        for other, pose in fixed.get(frame, {}).items():
            if other not in reached:
                reached[other] = _together(pose, reached[frame])
                frames.append(other)
    return "", reached[body]


def _moved(columns: Columns, kind: poses.Kind, rows: Any, body: str, pose: Pose) -> Columns:
    """Rows of a measured frame as poses of a body that has a pose in it."""
    found = {name: column[rows] for name, column in columns.items()}
    position, rotation = _poses(found, kind)
    place, turn = _together((position, _rotation(rotation)), pose)
    turned = np.where((rotation**2).sum(axis=1, keepdims=True) > 0, turn.as_quat(), np.nan)
    found.update(zip((path for paths in kind.fields() for path in paths), [*place.T, *turned.T]))
    if kind.body in found:
        found[kind.body] = np.full(len(place), body, object)
    return found
