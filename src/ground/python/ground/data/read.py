"""Reads recordings from paths, each under a name of its own."""

import glob
import os
from dataclasses import dataclass, fields, replace
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

from ground.reading import run_settings
from ground.reading.mapping import DEFAULT, FieldMapping, load
from ground.reading.recording import Recording
from ground.support.annotations import Path
from ground.support.command_line import number, option, positive, takes
from ground.support.errors import GroundError, GroundNote, RecordingWarning, warn
from ground.support.files import path_of
from ground.support.progress import Work
from ground.support.results import distinct_labels

_Given = Union[Recording, Path]
#: One or several; `ground.read` gives a tuple of those in a bag, and several such tuples are taken as well.
Recordings = Union[_Given, Iterable[Union[_Given, Sequence[_Given]]]]
NO_RECORDING = "no recordings are given"


@dataclass(frozen=True)
class ReadingOptions:
    """How recordings are read, and what replaces the settings that were recorded with them."""

    axes: Optional[str] = option(
        None, "world_ned x, y, z in the mocap's axes (as recorded, else '%s')" % run_settings.AXES
    )
    heading_offset: Optional[float] = option(
        None,
        "measured minus true heading, subtracted from the measured one [rad] (as recorded, else 0)",
        type=number,
        metavar="RAD",
    )
    mapping: Union[Path, FieldMapping, None] = option(
        None,
        "topics, fields, units and channels (identify info --write-mapping drafts one)",
        metavar="M.yaml",
    )
    types: Union[Path, Sequence[Path]] = option(
        (),
        ".msg files, or folders of them, for types of messages that a bag does not define",
        nargs="+",
        metavar="PATH",
    )
    pose_topic: Optional[str] = option(None, "topic of the poses", metavar="TOPIC")
    command_topic: Optional[str] = option(None, "topic of the commands", metavar="TOPIC")
    namespace: Optional[str] = option(
        None, "namespace of the craft's topics, where a bag contains several craft", metavar="NAME"
    )
    body: Optional[str] = option(
        None, "child frame of the craft, or a part of its topic's name", metavar="NAME"
    )
    noise: Optional[Tuple[float, float]] = option(
        None,
        "standard deviations of positions [m] and headings [rad] (found from the scatter of the poses)",
        type=positive,
        nargs=2,
        metavar=("M", "RAD"),
    )
    frame_rate: Optional[float] = option(
        None,
        "frame rate of the mocap's camera [Hz], if the stamps are late (found from stamps and motion)",
        type=positive,
        metavar="HZ",
    )
    stamps: Optional[str] = option(
        None,
        "nanoseconds after the point of the stamps in a table have no leading zeros: restore them",
        choices=["unpadded"],
    )

    def field_mapping(self) -> FieldMapping:
        """The mapping, with the values of the other options. GroundError names what is wrong in it."""
        said = {one.name: getattr(self, one.name) for one in fields(self)}
        given, types = said.pop("mapping") or DEFAULT, said.pop("types")
        mapping = given if isinstance(given, FieldMapping) else load(os.fspath(given))
        return mapping.with_options(**said, types=[os.fspath(file) for file in types])


@takes(ReadingOptions)
def read(bags: Union[Path, Iterable[Path]], *, options: ReadingOptions) -> Tuple[Recording, ...]:
    """Reads recordings from ROS 1 and ROS 2 bags, MCAP files and tables.

    Where a mapping is needed and none is given, one is drafted. If file and motion decide all of it, the
    draft is used, and `mapping` of the recordings holds its text; otherwise GroundError lists the open lines.

    Parameters
    ----------
    bags : path or iterable of path
        Paths of the files. A folder stands for the bags in it, a pattern (``flights/*.bag``) for its matches.

    Returns
    -------
    tuple of Recording
        The recordings. Runs of the same name are prefixed with the names of their folders.

    Raises
    ------
    GroundError
        When a file cannot be read, or a run is given twice, even as a copy.

    Warns
    -----
    GroundWarning
        When something in a file is unusual.

    Examples
    --------
    >>> run, = ground.read(bag)
    >>> run.name, run.eta.shape[1], run.controls.shape[1]  # x, y, psi; left, right, lift
    ('run', 3, 3)
    >>> list(run.to_frame().columns)
    ['t', 'x', 'y', 'psi', 'u', 'v', 'r', 'left', 'right', 'lift']
    """
    given_paths = bags if isinstance(bags, Iterable) and not isinstance(bags, str) else [bags]
    paths = [found for path in given_paths for found in _matching(path_of(path, "a recording"))]
    return tuple(reading(paths, options.field_mapping()))


def _matching(path: str) -> List[str]:
    """The files that match a pattern, by name; the path itself if it is none. GroundError without any."""
    if os.path.exists(path) or not glob.has_magic(path):
        return [path]
    found = sorted(glob.glob(path, recursive=True))
    if not found:
        raise GroundError("%s: no file matches this pattern" % path)
    return found


DRAFT = ".mapping.yaml"  # ends the name of a file with a drafted mapping, after the name of its run
DRAFTED = "%s: no mapping is given; the draft leaves nothing to decide, so it is used: see %s"
READING = "reading recordings (kB)"  # stage; unit: a kilobyte


def reading(
    paths: Sequence[str],
    mapping: FieldMapping = DEFAULT,
    work: Optional[Work] = None,
    folder: str = "",
) -> Iterator[Recording]:
    """The recordings in bags and folders, all read before the first one is returned; work: told of
    each that is read; folder: in which drafted mappings will be stored."""
    from ground.reading import readers, recorded_files  # recordings in memory need neither

    found, work = [], work or Work()
    bags = recorded_files.listed(paths, mapping)
    sizes = [recorded_files.size(path) // 1000 for path in bags]
    with work.stage(READING, sum(sizes)):
        for path, size in zip(bags, sizes):
            try:
                runs = [readers.read(path, mapping)]
            except GroundError as error:
                if mapping.file:
                    raise
                from ground.data import drafted  # the motion decides with it, which takes the checks

                runs = drafted.read(path, mapping, error)
                place = os.path.join(folder, runs[0].name + DRAFT) if folder else "its `mapping`"
                warn(DRAFTED % (path, place), GroundNote)
            work.step(size)
            found += runs
            for run in runs:
                for warning in run.warnings:
                    is_of_mapping = warning in mapping.undecided  # the same for all runs
                    text = warning if is_of_mapping else "%s: %s" % (run.path or path, warning)
                    warn(text, RecordingWarning)
    yield from distinct(found)


def distinct(found: Sequence[Recording], others: Sequence[Recording] = ()) -> List[Recording]:
    """Recordings with names that differ from each other and from the names of others. GroundError when two
    are the same run, by their contents."""
    first: Dict[str, Recording] = {}
    for one in found:
        if one.identity in first:
            what = "bag" if one.path else "recording"
            same = both(first[one.identity], one)
            raise GroundError("the same %s is given twice: %s" % (what, same))
        first[one.identity] = one
    names = distinct_labels(
        [one.name for one in found], [one.path for one in found], [one.name for one in others], "_"
    )
    return [
        one if one.name == name else replace(one, name=name, digest=one.identity)
        for one, name in zip(found, names)
    ]


def both(one: Recording, other: Recording) -> str:
    """Two recordings of the same run."""
    names = [recording.path or recording.name for recording in (one, other)]
    return " and ".join(dict.fromkeys(names))


def taken(given: Recordings) -> List[Recording]:
    """The given recordings, and those in the given bags, with names of their own. GroundError when one is
    given twice."""
    found = list(_flat(given))
    return distinct(found) if len(found) > 1 else found


def _flat(given: Any) -> Iterator[Recording]:
    """The given recordings, and those in the given bags, in sequences of any depth."""
    if isinstance(given, Recording):
        # Without what the runs of an earlier call decided.
        yield replace(given, decided=()) if given.decided else given
    elif hasattr(given, "columns"):
        raise GroundError("a table is not a recording; ground.Recording.from_frame(TABLE) converts it to one")
    elif isinstance(given, Iterable) and not isinstance(given, (str, os.PathLike)):
        for one in given:
            yield from _flat(one)
    else:
        yield from read(given)
