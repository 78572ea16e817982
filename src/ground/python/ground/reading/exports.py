"""Headers of the exports of motion capture programs: Motive, Qualisys Track Manager, Vicon.

Bodies are side by side in them, below several rows of names. A Head names each column by its body,
"craft.position.x", and knows units and rate.
"""

import csv
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground.reading import words
from ground.support.annotations import Array
from ground.support.errors import GroundError

if TYPE_CHECKING:
    import pandas


@dataclass
class Head:
    """What stands above the rows of a table."""

    first: int  #: number of the first line that has values
    names: List[str]  #: of the columns; empty for those that have none
    separator: str = ","  #: empty: blanks
    units: Dict[str, str] = field(default_factory=dict)  #: by name
    rate: float = 0.0  #: frames per second [Hz], for a column `frame`; 0: unknown
    euler: Tuple[str, ...] = ()  #: bodies whose rotation has three angles [deg]
    order: str = ""  #: of these angles
    zero_is_lost: bool = False  #: whether a row of zeros means a lost body
    is_export: bool = False  #: whether a program of motion capture has written it
    notes: List[str] = field(default_factory=list)


def recognised(lines: Sequence[str]) -> Optional[Head]:
    """The Head of an export; None where the lines are another table."""
    first = next((line for line in lines if line.strip()), "")
    if first.startswith("Format Version"):
        return _motive(lines)
    if first.startswith(("NO_OF_FRAMES", "NO_OF_CAMERAS")):
        return _qualisys(lines)
    if re.match(r'"?(Objects|Segments|Trajectories|Model Outputs)"?[,;\t]*$', first.strip()):
        return _vicon(lines)
    return None


def below_labview(lines: Sequence[str], notes: List[str]) -> Sequence[str]:
    """The lines below the heads of a file of LabVIEW, of which X_Value is the time; all lines of others."""
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        return lines
    last = max((n for n, line in enumerate(lines) if line.startswith("***End_of_Header***")), default=-1)
    notes.append("a LabVIEW file: its %d header lines are skipped, X_Value is the time" % (last + 1))
    names, *rows = lines[last + 1 :] or [""]
    return [names.replace("X_Value", "time [s]"), *rows]


def rate_said(above: Sequence[str]) -> float:
    """The rate of the rows that a line above them says [Hz]; 0 without one."""
    named = r"(?:rate|frequency|fps|hz)\b[^\d\w]*(?:\[?hz\]?[^\d\w]*)?(\d+(?:\.\d+)?)\s*(?:hz|fps)?\W*$"
    for line in above:
        said = re.search(named + r"|\b(\d+(?:\.\d+)?)\s*(?:hz|fps)\b", line.strip(), re.I)
        rate = float(said.group(1) or said.group(2)) if said else 0.0
        if rate > 0:
            return rate
    return 0.0


def _cells(line: str, separator: str = ",") -> List[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _filled(cells: Sequence[str]) -> List[str]:
    """Cells of which empty ones are those to their left."""
    found: List[str] = []
    for cell in cells:
        found.append(cell or (found[-1] if found else ""))
    return found


def _body(name: str) -> str:
    """The name of a body, without the name of its group."""
    return name.strip().strip('"').replace(".", "_")


def _frame_row(rows: Sequence[Sequence[str]], least: int, program: str) -> int:
    """Number of the row that begins with Frame. GroundError where fewer than `least` rows are above it."""
    found = next((n for n, cells in enumerate(rows) if cells[:1] == ["Frame"]), -1)
    if found < least:
        raise GroundError("the %s export lacks the row that begins with Frame" % program)
    return found


def _motive(lines: Sequence[str]) -> Head:
    """Type, name and ID of what is tracked in a row each, then rotation and position, then the axes."""
    head = _cells(lines[0])
    said = dict(zip(head[::2], head[1::2]))
    rows = [_cells(line) for line in lines[:20]]
    last = _frame_row(rows, 2, "Motive")
    above = [cells for cells in rows[1:last] if any(cells)]
    kinds = next((cells for cells in above if "Type" in cells[:2]), above[0])
    bodies = next((cells for cells in above if "Name" in cells[:2]), None)
    what, axes = above[-1], rows[last]
    if bodies is None:
        raise GroundError("the Motive export lacks its row of names")
    unit = words.unit(said.get("Length Units", "")) or "m"
    order = said.get("Rotation Type", "Quaternion")
    found = Head(last + 1, [], order="" if order == "Quaternion" else order)
    for column, axis in enumerate(axes):
        kind, body, part = (cells[column] if column < len(cells) else "" for cells in (kinds, bodies, what))
        if column < 2:
            found.names.append("time" if axis.startswith("Time") else axis.lower())
        elif "Rigid Body" in kind and "Marker" not in kind and part in ("Rotation", "Position"):
            name = "%s.%s.%s" % (_body(body), part.lower(), axis.lower())
            found.names.append(name)
            found.units[name] = unit if part == "Position" else "deg" if found.order else ""
        else:
            found.names.append("")
    found.units["time"] = "s"
    _note_bodies(found, "Motive", unit)
    return found


def _note_bodies(head: Head, program: str, unit: str) -> None:
    """Says which bodies are there, and which of them have angles instead of a quaternion."""
    head.is_export = True
    bodies = list(dict.fromkeys(name.split(".")[0] for name in head.names if ".position." in name))
    if not bodies:
        raise GroundError(
            "the %s export has no rigid bodies: export the rigid body of the craft, because markers "
            "have no heading" % program
        )
    head.euler = tuple(b for b in bodies if head.order and b + ".rotation.w" not in head.names)
    turned = "angles %s in degrees" % head.order if head.euler else "headings from rotations"
    text = "an export of %s: positions in %s, %s; its bodies are %s"
    head.notes.append(text % (program, unit, turned, ", ".join(bodies)))


def _qualisys(lines: Sequence[str]) -> Head:
    """A line for each fact, then one row of names, in which the name of a body stands before its X."""
    separator = "\t" if "\t" in lines[0] else ","
    rows = [_cells(line, separator) for line in lines[:60]]
    facts = {cells[0].upper(): cells[1:] for cells in rows if len(cells) > 1}
    if facts.get("DATA_INCLUDED", ["6D"])[0] != "6D":
        raise GroundError(
            "the Qualisys export has markers (%s): export 6D data, because markers have no heading"
            % facts["DATA_INCLUDED"][0]
        )
    ends = [{cell.split(" ")[-1] for cell in cells} for cells in rows]
    last = next((n for n, found in enumerate(ends) if found & {"Rot[0]", "Roll", "Yaw"}), -1)
    if last < 0:
        raise GroundError("the Qualisys export lacks a row that names Roll, Pitch and Yaw")
    bodies = [_body(name) for name in facts.get("BODY_NAMES", []) if name]
    found = Head(
        last + 1, [], separator, rate=float((facts.get("FREQUENCY") or ["0"])[0] or 0), zero_is_lost=True
    )
    number = -1
    plain = {"X": "position.x", "Y": "position.y", "Z": "position.z"}
    plain.update((name, name.lower()) for name in ("Roll", "Pitch", "Yaw"))
    names: List[str] = []
    values = _cells(lines[last + 1], separator) if len(lines) > last + 1 else []
    has_own = len(values) == len(rows[last])  # whether the cell of a body's name stands above one
    for cell in rows[last]:
        parts = cell.split(" ")
        if parts[-1] == "X":
            number += 1
        if number < 0 and cell in ("Frame", "Time"):
            names.append(cell.lower())
        elif parts[-1] in plain and number >= 0:
            named = bodies[number] if number < len(bodies) else _body(" ".join(parts[:-1]))
            names.append("%s.%s" % (named or "body_%d" % (number + 1), plain[parts[-1]]))
            found.units[names[-1]] = "mm" if parts[-1] in "XYZ" else "deg"
        elif cell in bodies and not has_own:  # a cell of its own above no values
            continue
        else:
            names.append("")
    found.names = names + [""] * (len([v for v in values if v]) - len(names))
    found.units.update(time="s")
    _note_bodies(found, "Qualisys", "mm")
    return found


def _vicon(lines: Sequence[str]) -> Head:
    """What it holds, the rate, the bodies, the names of columns and their units, each in a row."""
    separator = max(",;\t", key=lines[:5][-1].count)
    rows = [_cells(line, separator) for line in lines[:12]]
    last = _frame_row(rows[:-2], 3, "Vicon")
    bodies, units = _filled(rows[last - 1]), _cells(lines[last + 1], separator)
    digits = re.search(r"[\d.]+", rows[last - 2][0])
    found = Head(last + 2, [], separator, rate=float(digits.group()) if digits else 0.0)
    parts = {"TX": "position.x", "TY": "position.y", "TZ": "position.z"}
    parts.update(RX="angle.x", RY="angle.y", RZ="yaw", RW="angle.w")
    for column, cell in enumerate(rows[last]):
        body = _body((bodies[column] if column < len(bodies) else "").split(":")[-1])
        name = "%s.%s" % (body, parts[cell]) if cell in parts else cell.lower().replace(" ", "_")
        if cell not in parts and column > 1:
            name = ""
        found.names.append(name)
        if column < len(units) and name:
            found.units[name] = units[column]
    whole = [n[: -len("angle.w")] for n in found.names if n.endswith(".angle.w")]
    for body in whole:  # a quaternion, whose z is no angle
        for old, new in (("angle.x", "x"), ("angle.y", "y"), ("yaw", "z"), ("angle.w", "w")):
            found.names[found.names.index(body + old)] = "%srotation.%s" % (body, new)
    position = next((found.units.get(name, "") for name in found.names if ".position." in name), "")
    _note_bodies(found, "Vicon", position or "mm")
    return found


def complete(frame: "pandas.DataFrame", units: Dict[str, str], head: Head, notes: List[str]) -> None:
    """Adds quaternions to a table of angles, and leaves out the rows of lost bodies, in place. notes: told of
    these."""
    for body in head.euler:
        columns = ["%s.rotation.%s" % (body, axis.lower()) for axis in head.order]
        if set(columns) <= set(frame.columns):
            turned = _quaternions(frame[columns].to_numpy(float), head.order)
            for number, axis in enumerate("xyzw"):
                units.pop("%s.rotation.%s" % (body, axis), "")
                frame["%s.rotation.%s" % (body, axis)] = turned[:, number]
    bodies = {name.split(".")[0] for name in frame.columns if ".position." in name}
    for body in sorted(bodies) if head.zero_is_lost else ():
        columns = [name for name in frame.columns if name.startswith(body + ".")]
        lost = (frame[columns] == 0).all(axis=1)
        if lost.any():
            notes.append("rows without body %s are zero and left out (%d)" % (body, lost.sum()))
            frame.loc[lost, columns] = np.nan


def _quaternions(angles: Array, order: str) -> Array:
    """Quaternions x, y, z, w (n, 4) of angles (n, 3) [deg] about the axes of the body, in their order."""
    from scipy.spatial.transform import Rotation

    known = np.isfinite(angles).all(axis=1)
    found = np.full((len(angles), 4), np.nan)
    if known.any():
        found[known] = Rotation.from_euler(order.upper(), angles[known], degrees=True).as_quat()
    return found
