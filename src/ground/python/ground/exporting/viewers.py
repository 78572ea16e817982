"""Where a view goes: a websocket that Foxglove and Lichtblick open, and MCAP files."""

import contextlib
import importlib.util
import logging
import sys
from typing import Any, Iterator

from ground.support import files
from ground.support.errors import GroundError, reason

NEEDED = "viewers and MCAP files need the Python module foxglove-sdk"
OLDEST = (3, 10)  # Python of foxglove-sdk


def require() -> None:
    """Raises GroundError where foxglove-sdk is not installed."""
    if importlib.util.find_spec("foxglove") is not None:
        return
    if sys.version_info < OLDEST:
        raise GroundError(NEEDED + ", which needs Python %d.%d or newer, as Debian 12 has" % OLDEST)
    raise GroundError(NEEDED + ": pip install foxglove-sdk")


def context() -> Any:
    """A foxglove.Context, whose channels have what is shown. GroundError as from require."""
    require()
    import foxglove

    logging.getLogger("foxglove").setLevel(logging.CRITICAL)  # a viewer that closes is no error
    return foxglove.Context()


@contextlib.contextmanager
def served(shown: Any, name: str, host: str, port: int) -> Iterator[Any]:
    """Serves a context while the block runs; gives the foxglove.WebSocketServer. port: 0 for a free one.
    GroundError when the port cannot be had."""
    import foxglove

    try:
        server = foxglove.start_server(name=name, host=host, port=port, context=shown)
    except (RuntimeError, OSError, ValueError) as error:
        words = "cannot listen on %s, port %d (%s): choose another --port, or end the viewer that has it"
        raise GroundError(words % (host, port, error))
    try:
        yield server
    finally:
        server.stop()


@contextlib.contextmanager
def recorded(shown: Any, path: str) -> Iterator[Any]:
    """Writes a context to a new MCAP file while the block runs; gives the foxglove.MCAPWriter. GroundError
    when the file exists or cannot be written."""
    import foxglove

    files.refuse_existing(path, force=False)
    try:
        writer = foxglove.open_mcap(path, context=shown)
    except OSError as error:
        raise GroundError("%s: cannot be written (%s)" % (path, reason(error)))
    try:
        yield writer
    finally:
        writer.close()
