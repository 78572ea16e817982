"""Positions of any unit and origin in metres: lengths, coordinates of maps, latitude and longitude."""

from typing import Iterable, List, Sequence

import numpy as np

from ground.reading import containers, words
from ground.reading.containers import Columns
from ground.reading.mapping import FURTHER_LENGTHS, GEODETIC, LENGTHS, Poses
from ground.support.annotations import Array
from ground.support.errors import GroundError

MAX_COORDINATE = 1e4  # coordinates whose median is larger count from the first pose [m]
RADIUS, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84 [m], [-]
STILL = 1e-3  # positions that change by less than this share of themselves may be degrees


def unit_of(columns: Columns, paths: Sequence[str], known: Iterable[str], what: str, notes: List[str]) -> str:
    """The unit that the file gives the columns of something; empty where it gives none or several."""
    found = {containers.unit(columns, path) for path in paths}
    unit = found.pop() if len(found) == 1 else ""
    if unit not in known:
        return ""
    notes.append("%s in %s, as in the name of column %s" % (what, unit, paths[0]))
    return unit


def metres(
    numbers: Array, paths: Sequence[str], columns: Columns, poses: Poses, where: str, notes: List[str]
) -> Array:
    """Positions (n, k) of fields in metres. notes: told what was assumed."""
    lengths = {**LENGTHS, **FURTHER_LENGTHS}
    is_geodetic = {words.axis(path)[0] for path in paths[:2]} == {"lat", "lon"}
    unit = poses.unit or (GEODETIC if is_geodetic else "")
    unit = unit or unit_of(columns, paths, {*lengths, GEODETIC} - {"m"}, "positions are", notes)
    if unit == GEODETIC:
        return _local(numbers, paths, where, notes)
    if not poses.unit and unit in ("", "m"):
        _check_degrees(numbers, where)
    return np.asarray(numbers * (lengths[unit or "m"] * poses.scale))


def _local(numbers: Array, paths: Sequence[str], where: str, notes: List[str]) -> Array:
    """Distances north and east of the first fix (n, k) [m], in the columns of latitude and longitude."""
    north = int(words.axis(paths[0])[0] == "lon" or words.axis(paths[1])[0] == "lat")
    fixes = numbers[:, [north, 1 - north]]
    valid = np.isfinite(fixes).all(axis=1)
    if not valid.any() or (np.abs(fixes[valid]) > [90, 360]).any():
        raise GroundError(
            "%s: %s and %s are not latitude and longitude in degrees: they range from %g to %g and from "
            "%g to %g" % (where, paths[0], paths[1], *np.ravel(_reach(numbers[:, :2])))
        )
    first = fixes[valid][0]
    sine = np.sin(np.radians(first[0]))
    square = FLATTENING * (2 - FLATTENING)
    across = RADIUS / np.sqrt(1 - square * sine**2)
    along = across * (1 - square) / (1 - square * sine**2)
    scale = np.radians(1) * np.array([along, across * np.cos(np.radians(first[0]))])
    found = numbers.copy()
    found[:, [north, 1 - north]] = (fixes - first) * scale
    notes.append(
        "positions are latitude and longitude: distances north and east of the first fix, %.7f, %.7f deg"
        % tuple(first)
    )
    return found


def _reach(numbers: Array) -> Array:
    """Least and largest of columns (k, 2); NaN without any."""
    finite = np.where(np.isfinite(numbers), numbers, np.nan)
    if np.isnan(finite).all(axis=0).any():
        return np.full((numbers.shape[1], 2), np.nan)
    return np.column_stack([np.nanmin(finite, axis=0), np.nanmax(finite, axis=0)])


def look_geodetic(numbers: Array) -> bool:
    """Whether positions (n, k) without a unit look like latitude and longitude: they hardly change against
    their size, and both are angles."""
    reach = _reach(numbers[:, :2])
    spread, middle = np.ptp(reach, axis=1), np.abs(reach).max(axis=1)
    still = (spread > 0).all() and (spread < STILL * middle).all() and spread.max() < 0.1
    return bool(still and ((middle <= [90, 180]).all() or (middle <= [180, 90]).all()))


def _check_degrees(numbers: Array, where: str) -> None:
    """GroundError where positions without a unit look like latitude and longitude."""
    if look_geodetic(numbers):
        reach = _reach(numbers[:, :2])
        raise GroundError(
            "%s: positions stay within %.2g of %.6g and %.6g: they look like latitude and longitude in "
            "degrees; position: {unit: deg} under poses in the mapping gives metres (unit: m if they "
            "are metres)" % (where, np.ptp(reach, axis=1).max(), *np.abs(reach).max(axis=1))
        )


def subtract_origin(rows: Array, notes: List[str]) -> None:
    """Makes poses (n, 3) that are far from the origin count from the first one, in place."""
    valid = np.isfinite(rows).all(axis=1)
    if not valid.any():
        return
    middle = np.median(rows[valid, :2], axis=0)
    if np.abs(middle).max() <= MAX_COORDINATE:
        return
    near = valid & (np.abs(rows[:, :2] - middle) < MAX_COORDINATE).all(axis=1)
    origin = rows[near][0, :2].copy() if near.any() else middle
    rows[:, :2] -= origin
    notes.append(
        "positions are far from the origin, as map coordinates are: the first pose, x %.3f m, y %.3f m, "
        "is subtracted" % tuple(origin)
    )
