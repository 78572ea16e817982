"""The folder of a discovery: its story, inputs, recordings and models.

A step writes its files first, then the story, which is replaced as a whole. What the story does not have
did not happen: an interrupted step is repeated, and replaces its files.
"""

import os
import re
from typing import List, Optional

from ground import _core
from ground.discovery.story import SCHEMA, Story
from ground.reports import result_folder
from ground.support import files
from ground.support.annotations import Array
from ground.support.errors import GroundError, core_errors

STORY = "journal.json"
FIRST = "model-00.yaml"  # the only file that is written before there is a story
_TEMPORARY = re.compile(r"\.ground-.*|model-\d+\.yaml\.\w{6}")  # files of a process that was killed


class Journal:
    """A folder that keeps a discovery, or nothing if there is none."""

    def __init__(self, folder: str) -> None:
        """folder: created if it does not exist; empty: nothing is kept. GroundError when it cannot
        be written."""
        self.folder = os.path.abspath(folder) if folder else ""
        if not folder:
            return
        try:
            os.makedirs(self.folder, exist_ok=True)
        except OSError as error:
            raise GroundError("%s: cannot be created (%s)" % (folder, error.strerror))
        if set(self._files()) <= {FIRST} or os.path.exists(self.path(STORY)):
            for name in filter(_TEMPORARY.fullmatch, os.listdir(self.folder)):
                os.unlink(os.path.join(self.folder, name))

    def _files(self) -> List[str]:
        """Names in the folder, without temporary files."""
        return [name for name in os.listdir(self.folder) if not _TEMPORARY.fullmatch(name)]

    def path(self, name: str) -> str:
        """Path of a file in the folder; empty without a folder or a name."""
        return os.path.join(self.folder, name) if self.folder and name else ""

    def begin(self, given: _core.Model) -> None:
        """Writes the given model into a folder without a story. GroundError when the folder has other
        files than an interrupted beginning leaves."""
        if not self.folder:
            return
        names = self._files()
        if names and (names != [FIRST] or self.model(FIRST).format() != given.format()):
            raise GroundError(
                "%s contains files, but no %s: name a new folder, or the folder of a discovery"
                % (self.folder, STORY)
            )
        self.keep_model(FIRST, given)

    def story(self) -> Optional[Story]:
        """The story that the folder keeps; None when there is none. GroundError when it cannot be
        read."""
        path = self.path(STORY)
        return read(path) if path and os.path.exists(path) else None

    def keep(self, story: Story) -> None:
        """Replaces the story."""
        if self.folder:
            files.write_json(self.path(STORY), story.to_dict(), force=True)

    def keep_inputs(self, name: str, channels: List[str], rows: Array) -> None:
        """Writes inputs as a CSV file that a controller can play."""
        if self.folder:
            files.write_csv(self.path(name), ",".join(["time", *channels]), rows.tolist(), True)

    def model(self, name: str) -> _core.Model:
        """The model of a file of the folder; GroundError when it cannot be read."""
        with core_errors():
            return _core.load_model(self.path(name))

    def keep_model(self, name: str, model: _core.Model) -> None:
        """Writes a model file."""
        if self.folder:
            files.write_text(self.path(name), model.format(), force=True)


def read(path: str) -> Story:
    """The story in a file. GroundError when it cannot be read."""
    try:
        return Story.from_dict(result_folder.read(*os.path.split(path), SCHEMA))
    except (GroundError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise GroundError("%s is not a discovery's journal (%s)" % (path, error))
