"""Bags of ROS 1 and 2 and MCAP files as containers.

Sound ones are read by rosbags; of others, what is whole in them is read.
"""

import contextlib
import os
import re
import shutil
import sqlite3
import tempfile
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ground.reading import damaged, decoding, definitions, recorded_files, streams, ulogs
from ground.reading.containers import RECEIVED, Columns, Container, Topic
from ground.reading.streams import Source, Stream
from ground.support.annotations import Indices
from ground.support.errors import GroundError

LATEST = 2**63  # end of the times of receipt that columns hold [ns]
LISTS = {"tf2_msgs/TFMessage": "transforms", "tf/tfMessage": "transforms"}  # types that are lists of rows


def opened(path: str, types: Sequence[str] = ()) -> Container:
    """A bag, or a log of PX4. types: files with definitions of types, or folders of them. GroundError when it
    cannot be read."""
    if recorded_files.begins(path) == recorded_files.ULOG:
        return ulogs.Ulog(path)
    return Bag(path, definitions.Definitions(types))


class Bag(Container):
    """A bag of ROS 1 or 2, or an MCAP file. given: definitions of types that it may not hold. Raises
    GroundError when it cannot be read."""

    def __init__(self, path: str, given: definitions.Definitions = definitions.NONE) -> None:
        super().__init__(path)
        self._given = given
        self._source = _opened(path)
        self.warnings += self._source.warnings
        for topic in dict.fromkeys(one.topic for one in self._source.streams):
            every = self._of(topic)
            used = [one for one in every if one.count]
            kinds = " and ".join(sorted({streams.plain(one.kind) for one in used or every}))
            unknown = any(definitions.is_undefined(one, given) for one in used)
            self.topics[topic] = Topic(kinds, sum(one.count for one in used), unknown)

    def _of(self, topic: str, kind: str = "") -> List[Stream]:
        """The streams of a topic, of one type or all."""
        return [one for one in self._source.streams if one.topic == topic and kind in ("", one.kind)]

    def table(self, topic: str) -> Columns:
        """See Container."""
        parts: List[Columns] = []
        for kind in sorted({one.kind for one in self._of(topic)}):
            received, messages = self._messages(topic, kind)
            if not messages:
                continue
            try:
                found, lost = self._columns(self._of(topic, kind)[0], messages)
            except GroundError as error:
                raise GroundError("%s: %s" % (self.path, error))
            if lost:
                self.warnings.append(
                    "the bag is damaged: messages on %s that do not fit their type were left out (%d)"
                    % (topic, lost)
                )
            parts += [{RECEIVED: received[at], **columns} for at, columns in found]
        return _joined(parts)

    def _columns(
        self, stream: Stream, messages: Sequence[bytes]
    ) -> Tuple[List[Tuple[Indices, Columns]], int]:
        """The columns of messages that are alike, with their numbers, and how many are lost."""
        if stream.encoding not in streams.ENCODINGS:
            raise GroundError(
                "%s: messages in the encoding '%s' are not read; mcap cat %s --topics %s --json prints those "
                "in JSON and protobuf: convert their values to a table"
                % (stream.topic, stream.encoding, self.path, stream.topic)
            )
        file = definitions.is_given(stream, self._given)
        types = definitions.types_of(stream, self._given)
        if file:
            definitions.check_digest(stream, types, file)
        layouts = decoding.Layouts(types, stream.kind, stream.encoding == "ros1")
        plain = streams.plain(stream.kind)
        found, lost = layouts.columns(messages, LISTS.get(plain, ""))
        doubts = layouts.doubts() if file else []
        if not found or (file and lost > max(1, decoding.RARE * len(messages))):
            numbers = len(messages) - lost, len(messages), plain, file or "the bag"
            text = "%s: only %d of its %d messages fit the definition of %s in %s"
            raise GroundError(stream.topic + text[2:] % numbers)
        if doubts:
            raise GroundError(
                "%s: the definition of %s in %s is probably not the one that was used: with it, %s would "
                "have impossible values" % (stream.topic, plain, file, ", ".join(doubts[:3]))
            )
        return found, lost

    def _messages(self, topic: str, kind: str) -> Tuple[Indices, List[bytes]]:
        """Times of receipt [ns] and contents of messages in this order, as far as they can be read."""
        try:
            rows = list(self._source.messages(self._of(topic, kind)))
        except Exception as error:  # the file ends early, or a chunk is damaged
            self._source.close()
            self._source = _salvaged(self.path, error)
            self.warnings += [text for text in self._source.warnings if text not in self.warnings]
            rows = list(self._source.messages(self._of(topic, kind)))
        known = [(time, message) for time, message in rows if time < LATEST]
        if len(known) < len(rows):
            self.warnings.append(
                "the bag is damaged: messages on %s that were received after the year 2262 were left out (%d)"
                % (topic, len(rows) - len(known))
            )
        received = np.array([time for time, _ in known], np.int64)
        order = np.argsort(received, kind="stable")
        return received[order], [known[i][1] for i in order]

    def close(self) -> None:
        """See Container."""
        self._source.close()


def _joined(parts: Sequence[Columns]) -> Columns:
    """Columns of all parts in the order of receipt; a number that a part lacks is NaN, a text is empty."""
    if len(parts) == 1:
        return parts[0]
    found: Columns = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        like = next(part[name] for part in parts if name in part)
        missing = "" if like.dtype == object else np.nan
        found[name] = np.concatenate(
            [p[name] if name in p else np.full(len(p[RECEIVED]), missing) for p in parts]
        )
    if parts:
        order = np.argsort(found[RECEIVED], kind="stable")
        found = {name: column[order] for name, column in found.items()}
    return found


def _opened(path: str) -> Source:
    """What is in a bag. GroundError when nothing of it can be read."""
    try:
        import rosbags  # noqa: F401
    except ImportError:
        raise GroundError("%s: bags need the Python module rosbags: pip install rosbags" % path)
    try:
        if any(os.path.isfile(path + end) and os.path.getsize(path + end) for end in recorded_files.BESIDE):
            return _Journaled(path)
        sound = streams.Sound(path, recorded_files.begins(path) == recorded_files.ROS1)
    except Exception as error:  # rosbags, SQLite and their parsers raise many kinds
        return _salvaged(path, error)
    beside = os.path.join(os.path.dirname(path) or ".", recorded_files.METADATA)
    if path.endswith(".db3") and os.path.isfile(path) and not os.path.isfile(beside):
        sound.warnings.append(
            "there is no %s next to it: the recorder was perhaps killed, and its last messages may be missing"
            % recorded_files.METADATA
        )
    return sound


class _Journaled(streams.Sound):
    """A bag of ROS 2 in SQLite that was not closed, completed by what SQLite keeps beside it."""

    def __init__(self, path: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        copy = os.path.join(self._folder.name, os.path.basename(path))
        for end in ("", *recorded_files.BESIDE):
            if os.path.isfile(path + end):
                shutil.copyfile(path + end, copy + end)
        with contextlib.closing(sqlite3.connect(copy)) as file:
            file.execute("PRAGMA journal_mode=DELETE")
        super().__init__(copy, False)
        self.warnings.append(damaged.ENDS)

    def close(self) -> None:
        """See Source."""
        super().close()
        self._folder.cleanup()


def _salvaged(path: str, cause: Any) -> Source:
    """What is whole in a damaged bag, or in one that rosbags does not read. GroundError without any
    message."""
    if os.path.isdir(path):
        return _in_folder(path, cause)
    scans = {recorded_files.ROS1: damaged.ros1, recorded_files.MCAP: damaged.mcap}
    magic = recorded_files.begins(path)
    found: Optional[Source] = None
    try:
        found = damaged.Damaged(path, scans[magic]) if magic in scans else None
    except OSError as error:
        cause = error
    if found is None or not any(stream.count for stream in found.streams):
        if magic == recorded_files.SQLITE:
            raise GroundError(
                "%s: the bag is damaged (%s): sqlite3 %s .recover | sqlite3 NEW.db3 saves what is whole"
                % (path, definitions.said(cause), path)
            )
        said = definitions.said(cause)
        raise GroundError("%s: cannot be read as a bag (%s), and no message is intact" % (path, said))
    return found


def _in_folder(folder: str, cause: Any) -> Source:
    """The files of a bag of ROS 2 whose description is missing or wrong."""
    names = [name for name in os.listdir(folder) if name.endswith(recorded_files.BAGS)]
    names.sort(key=lambda name: [int(n) for n in re.findall(r"\d+", os.path.splitext(name)[0])][-1:])
    files = [os.path.join(folder, name) for name in names]
    if not files:
        raise GroundError("%s: cannot be read as a bag (%s)" % (folder, definitions.said(cause)))
    found = streams.Pieces([_opened(file) for file in files])
    found.warnings = [text for text in found.warnings if recorded_files.METADATA not in text]
    reason = "is missing"
    if os.path.isfile(os.path.join(folder, recorded_files.METADATA)):
        reason = "cannot be used (%s)" % definitions.said(cause)
    found.warnings.append(
        "%s %s: read from %s as one bag; the last messages may be missing"
        % (recorded_files.METADATA, reason, ", ".join(os.path.basename(file) for file in files))
    )
    return found
