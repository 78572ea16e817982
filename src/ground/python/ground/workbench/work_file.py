"""The work file: what was done, a line of JSON for each step, on the disk before the page hears of it."""

import contextlib
import fcntl
import json
import os
from typing import Iterator, List

from ground.support import files
from ground.support.annotations import Document
from ground.support.errors import GroundError

NAME = "work.jsonl"
SCHEMA = "ground/workbench/1"


class WorkFile:
    """Events of a workbench. A line that was cut off by a crash is dropped. One process has it at a time."""

    def __init__(self, folder: str) -> None:
        """GroundError when it cannot be written, or another workbench has it."""
        self.path = os.path.join(folder, NAME)
        try:
            self._file = open(self.path, "a+b")
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise GroundError("%s: another workbench works on it; give -o another folder" % self.path)
        except OSError as error:
            raise GroundError("%s: cannot be written (%s)" % (self.path, error.strerror))
        self.events = self._read()

    def _read(self) -> List[Document]:
        """The events; what follows the last whole one is cut off."""
        self._file.seek(0)
        found, good = [], 0
        for line in self._lines():
            with contextlib.suppress(ValueError):
                event = json.loads(line)
                if isinstance(event, dict) and line.endswith(b"\n"):
                    found.append(event)
                    good += len(line)
                    continue
            break
        rest = self._file.seek(0, os.SEEK_END) - good
        if rest and b"\n" in self._after(good)[:-1]:
            raise GroundError("%s: line %d is damaged" % (self.path, len(found) + 1))
        self._file.truncate(good)
        if found and found[0].get("schema") != SCHEMA:
            raise GroundError("%s: not the work file of a workbench" % self.path)
        return found

    def _lines(self) -> Iterator[bytes]:
        yield from self._file

    def _after(self, place: int) -> bytes:
        self._file.seek(place)
        return self._file.read()

    def add(self, event: Document) -> None:
        """Appends an event; it is on the disk when this returns."""
        self._file.write(json.dumps(files.plain(event), separators=(",", ":")).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
