"""Poses of a body that static transforms fix to a measured frame: tf_static, or constant ones of tf."""

from typing import Dict, List, Tuple

import numpy as np

from ground.reading import pose_columns
from ground.reading.containers import Columns, Container
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

Fixed = Dict[str, Dict[str, Array]]  # of each frame: its pose (4, 4) in the frames that it is fixed to


def of_body(source: Container, topic: str, columns: Columns, body: str, notes: List[str]) -> Columns:
    """The columns of a topic with poses; where the body is fixed to a measured frame, as poses of the body.
    body: empty: what is measured; notes: receives what was assumed. GroundError when no frame is named so."""
    kind, body = pose_columns.KINDS.get(source.topics[topic].kind), body.strip("/")
    if kind is None or not kind.orientation or not (body or kind is pose_columns.TRANSFORM):
        return columns
    fixed: Fixed = {}
    names = _frames(columns, kind.body) if kind.body in columns else np.array(topic.split("/"), object)
    moving = ~_add(fixed, columns) if kind is pose_columns.TRANSFORM else np.ones(len(names), bool)
    for other in source.of_kind("tf2_msgs/TFMessage") + source.of_kind("tf/tfMessage"):
        _add(fixed, source.table(other) if other != topic else columns)
    measured = sorted(set(names[moving]))
    found = {frame: (one, pose) for one in measured for frame, pose in _reached(fixed, one).items()}
    known = ", ".join("%s (fixed to %s)" % (frame, found[frame][0]) for frame in sorted(found))
    if body in found and body not in measured:
        parent, pose = found[body]
        turn = np.degrees(np.arccos(np.clip(0.5 * np.trace(pose[:3, :3]) - 0.5, -1, 1)))
        text = "%s is fixed to %s by static transforms: %.3g m away, turned by %.3g deg"
        notes.append(text % (body, parent, np.linalg.norm(pose[:3, 3]), turn))
        rows = (names == parent) & moving if kind.body in columns else slice(None)
        return _moved({name: column[rows] for name, column in columns.items()}, kind, body, pose)
    if known and not body:
        notes.append("--body also accepts frames that are fixed by static transforms: " + known)
    elif known and body not in {*names, *topic.split("/")}:
        there = ", ".join([*measured, known])
        raise GroundError("%s: %s: no body is named %s; there are %s" % (source.path, topic, body, there))
    return columns


def _frames(columns: Columns, path: str) -> Array:
    """Names of frames (n,), without slashes at their ends."""
    return np.array([str(name).strip("/") for name in columns[path]], object)


def _poses(columns: Columns, kind: pose_columns.PoseFields) -> Tuple[Array, Flags]:
    """Poses (n, 4, 4) of columns, and which quaternions are rotations (n,)."""
    from scipy.spatial.transform import Rotation  # slow to load

    position, rotation = (np.column_stack([columns[path] for path in paths]) for paths in kind.fields())
    valid, found = (rotation**2).sum(axis=1) > 0, np.tile(np.eye(4), (len(position), 1, 1))
    rotation[~valid] = [0.0, 0.0, 0.0, 1.0]
    found[:, :3, :3], found[:, :3, 3] = Rotation.from_quat(rotation).as_matrix(), position
    return found, np.asarray(valid)


def _add(fixed: Fixed, columns: Columns) -> Flags:
    """Adds the transforms that never change; which rows (n,) they are."""
    parents, children = (_frames(columns, path) for path in ("header.frame_id", "child_frame_id"))
    every, still = _poses(columns, pose_columns.TRANSFORM)[0], np.zeros(len(parents), bool)
    for parent, child in set(zip(parents, children)):
        some = (parents == parent) & (children == child)
        if (every[some] == every[some][0]).all():
            still |= some
            fixed.setdefault(child, {})[parent] = every[some][0]
            fixed.setdefault(parent, {})[child] = np.linalg.inv(every[some][0])
    return still


def _reached(fixed: Fixed, measured: str) -> Dict[str, Array]:
    """The frames that are fixed to a measured one, and their poses in it."""
    found, frames = {measured: np.eye(4)}, [measured]
    for frame in frames:
        for other in set(fixed.get(frame, {})) - set(found):
            found[other] = found[frame] @ fixed[other][frame]
            frames.append(other)
    del found[measured]
    return found


def _moved(columns: Columns, kind: pose_columns.PoseFields, body: str, pose: Array) -> Columns:
    """Poses of a measured frame as poses of a body that has a pose in it."""
    from scipy.spatial.transform import Rotation

    found, valid = _poses(columns, kind)
    found = found @ pose
    found[~valid, :3, 3] = np.nan
    values = [*found[:, :3, 3].T, *Rotation.from_matrix(found[:, :3, :3]).as_quat().T]
    moved = {**columns, **dict(zip((path for paths in kind.fields() for path in paths), values))}
    return {**moved, kind.body: np.full(len(found), body, object)} if kind.body in columns else moved
