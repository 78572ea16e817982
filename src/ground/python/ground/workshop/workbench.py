"""workbench: a page on this computer to fit a model, see where it fails, and add what is missing."""

import argparse
import contextlib
import multiprocessing
import os
import pathlib
import socket
import sys
import webbrowser
from dataclasses import asdict, dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from ground.data import bag_arguments
from ground.data.measured import repaired
from ground.data.read import Recordings, distinct, read, taken
from ground.models import Model, ModelLike, Room, RoomLike
from ground.reading.recording import Recording
from ground.support import command_line
from ground.support.annotations import Document, Path
from ground.support.command_line import option
from ground.support.errors import GroundError, OptionError
from ground.support.event_file import EventFile
from ground.support.jobs import Jobs
from ground.support.local_server import Action, Server, packed, serve
from ground.support.progress import Progress, Work, say
from ground.workshop import scripts, views, work
from ground.workshop.session import FIT, SCHEMA, Session

PAGE = ("page.html", "page.css", "page.js")  # files beside this one


@dataclass(frozen=True)
class WorkbenchOptions:
    """Where the page is."""

    port: int = option(0, "port on the loopback address (a free one)", type=int, range=(0, 65535))
    no_browser: bool = option(False, "print the address, and open no browser")
    room: Optional[RoomLike] = option(
        None, "room of the next experiment (default: the first one recorded with a run)", metavar="ROOM.yaml"
    )


@command_line.takes(WorkbenchOptions)
def workbench(
    recordings: Recordings,
    model: ModelLike,
    *,
    output: Path = "workbench",
    holdout: Recordings = (),
    reading: Mapping[str, Any] = {},
    progress: Progress = None,
    begun: Optional[Callable[[str], None]] = None,
    options: WorkbenchOptions,
) -> None:
    """Serves a page on this computer until Ctrl-C: measured against predicted motion, fits, missing effects.

    Parameters
    ----------
    model : Model or path
        The model to start from.
    output : path, default 'workbench'
        Folder of the work file, which restores everything at the next start, and of saved results.
    reading : mapping, optional
        Options of ground.read, for reading bags here and in saved scripts.
    begun : callable, optional
        Called with the address of the page.

    Raises
    ------
    GroundError
        When a file cannot be read, or the system has no fork (Windows).

    Examples
    --------
    >>> def seen(address):  # a program of your own may open it
    ...     raise SystemExit("at %s..." % address[:17])
    >>> ground.workbench(bag, model_file, begun=seen)
    Traceback (most recent call last):
    ...
    SystemExit: at http://127.0.0.1:...
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        raise GroundError("the workbench needs Linux or macOS")
    given, told = Model.of(model), Work.of(progress)
    fitted, held = _taken(recordings, reading), _taken(holdout, reading)
    runs = [run.with_lift_of(given.core) for run in distinct([*fitted, *held])]
    if not runs:
        raise GroundError("no recordings are given")
    repaired(runs, told, given.core)
    folder = os.path.abspath(os.fspath(output))
    os.makedirs(folder, exist_ok=True)
    wanted = Room.of(options.room) if options.room else None
    room = wanted or next(filter(None, map(Room.of_recording, runs)), None)
    # Before the work file is open: its lock ends with this process, also where a job lives longer.
    with contextlib.closing(Jobs(work.worker(runs, room), lambda *told: session.heard(*told))) as jobs:  # noqa: PLW0108
        file = EventFile(os.path.join(folder, "work.jsonl"), SCHEMA)
        session = Session(runs, given, [run.name for run in runs[len(fitted) :]], room, file, jobs)
        server = Server(options.port, _files(), actions(session, folder, reading), session.wait)
        if begun:
            begun(server.address)
        try:
            serve(server)
        finally:
            session.end()


def _taken(given: Recordings, reading: Mapping[str, Any]) -> List[Recording]:
    """The recordings, and those in the bags, read with some options."""
    every = [given] if isinstance(given, (Recording, str, os.PathLike)) else given
    return taken([read(one, **reading) if isinstance(one, (str, os.PathLike)) else one for one in every])


def _files() -> Dict[str, Tuple[bytes, str]]:
    """What the browser loads."""
    from plotly.offline import get_plotlyjs

    texts = {name: pathlib.Path(__file__).with_name(name).read_text("utf-8") for name in PAGE}
    own = {"/" if name == "page.html" else "/" + name: packed(name, text) for name, text in texts.items()}
    return {"/plotly.js": packed("plotly.js", get_plotlyjs()), **own}


def actions(session: Session, folder: str, reading: Mapping[str, object]) -> Dict[str, Action]:
    """What the page may ask for, by name."""

    def part(of: Document) -> views.Span:
        ready = session.predictor([str(of["run"])], {})
        model = session.varied(int(of["node"]), dict(of.get("values", {})))
        start, end = float(of.get("from") or 0.0), float(of["to"]) if of.get("to") else float("inf")
        return views.Span(ready, model, str(of["run"]), start, end)

    def error(of: Document) -> Dict[str, object]:
        model = session.varied(int(of["node"]), dict(of.get("values", {})))
        found = asdict(session.predictor(session.names(FIT)).error(model))
        return {**found, **session.beside_mocap(found)}

    def done(act: Action) -> Action:
        return lambda of: {"done": act(of)}

    return {
        "state": lambda of: session.state(),
        "measured": lambda of: views.measured(part(of)),
        "curves": lambda of: {"predicted": views.curves(part(of))},
        "error": error,
        "missing": lambda of: views.missing(part(of)),
        "set": done(lambda of: session.set_values(int(of["node"]), dict(of["values"]))),
        "select": done(lambda of: session.select(int(of["node"]))),
        "undo": done(lambda of: session.undo()),
        "role": done(lambda of: session.set_role(str(of["run"]), str(of["role"]))),
        "cut": done(lambda of: session.cut(str(of["run"]), of["span"])),
        "judge": done(lambda of: session.judge_on(str(of["run"]), of["span"])),
        "open": done(lambda of: session.open()),
        "begin": done(lambda of: session.begin(_kind(of["kind"]), of.get("effect"))),
        "stop": done(lambda of: session.stop(int(of["job"]))),
        "check": lambda of: session.check(dict(of["formula"])),
        "save": done(lambda of: scripts.save(session, folder, reading)),
    }


def _kind(given: object) -> str:
    if given not in ("fit", "add", "try", "search"):
        raise GroundError("unknown kind of work")
    return str(given)


def told_of(address: str, has_display: bool) -> Sequence[str]:
    """What is printed when the page is there."""
    port = address.partition("127.0.0.1:")[2].partition("/")[0]
    lines = ["The workbench is at %s (Ctrl-C ends it)" % address]
    if not has_display:
        lines.append("From another computer: ssh -L %s:127.0.0.1:%s %s, then open that address there"
                     % (port, port, socket.gethostname()))  # fmt: skip
    return lines


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify workbench."""
    bag_arguments.add_bag_arguments(parser)
    command_line.add_model(parser, "the model to start from")
    help = "folder of the work file and of saved results (%(default)s)"
    parser.add_argument("-o", "--output", metavar="DIR", default="workbench", help=help)
    bag_arguments.add_holdout_argument(parser)
    command_line.add_options(parser, WorkbenchOptions)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify workbench; returns what --json prints."""
    if arguments.leave_out:
        raise OptionError("{0}: leave stretches out on the page", "leave_out")
    has_display = sys.platform == "darwin" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))

    def begun(address: str) -> None:
        for line in told_of(address, has_display):
            say(line, sys.stderr if arguments.json else None)
        if has_display and not arguments.no_browser:
            webbrowser.open(address)

    with contextlib.suppress(KeyboardInterrupt):
        workbench(
            bag_arguments.reading(arguments, arguments.bags),
            arguments.model,
            output=arguments.output,
            holdout=bag_arguments.reading(arguments, arguments.holdout),
            reading=bag_arguments.reading_options(arguments),
            begun=begun,
            options=command_line.options(arguments, WorkbenchOptions),
            progress=arguments.work,
        )
    return {"output": arguments.output}
