"""A file of events: what was done, a line of JSON for each step, on the disk before anybody hears of it."""

import json
import os
from typing import List, Mapping

from ground.support import files
from ground.support.annotations import Document
from ground.support.errors import GroundError, reason


class EventFile:
    """Events, appended. A line that was cut off by a crash is dropped. One process has the file at a time."""

    def __init__(self, path: str, schema: str) -> None:
        """schema: of the first event. GroundError when the file cannot be written, is damaged or of another
        schema, or another process has it."""
        import fcntl  # not everywhere

        self.path = path
        try:
            self._file = open(self.path, "a+b", buffering=0)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise GroundError("%s: another process works on it; give -o another folder" % self.path)
        except OSError as error:
            raise GroundError("%s: cannot be written (%s)" % (self.path, reason(error)))
        self._file.seek(0)
        *lines, rest = self._file.read().split(b"\n")
        self.events: List[Document] = []
        for number, line in enumerate(lines, 1):
            try:
                self.events.append(dict(json.loads(line)))
            except (ValueError, TypeError):
                raise GroundError("%s: line %d is damaged" % (self.path, number))
        if self.events and self.events[0].get("schema") != schema:
            raise GroundError("%s: not a file of the schema %s" % (self.path, schema))
        self._size = os.fstat(self._file.fileno()).st_size - len(rest)
        self._file.truncate(self._size)

    def add(self, event: Mapping[str, object]) -> None:
        """Appends an event, which is on the disk when this returns; GroundError when that is not possible."""
        line = json.dumps(files.plain(event), separators=(",", ":")).encode() + b"\n"
        try:
            if self._file.write(line) != len(line):
                raise GroundError("%s: cannot be written; make room" % self.path)
            os.fsync(self._file.fileno())
        except (OSError, GroundError) as error:
            self._file.truncate(self._size)
            raise GroundError("%s: cannot be written (%s)" % (self.path, getattr(error, "strerror", error)))
        self._size += len(line)
