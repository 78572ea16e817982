"""Errors and warnings: a failed program prints one line, and may list points, and exits with status 1."""

import argparse
import contextlib
import difflib
import errno
import os
import sys
import traceback
import warnings
from typing import Any, Callable, Iterable, Iterator, Set, TextIO, Type

from ground.support.docstrings import Described
from ground.support.progress import harmless, say

# What a user can do about errors of the operating system.
ADVICE = {
    errno.ENOSPC: "make room, or name another folder",
    errno.EDQUOT: "make room, or name another folder",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EISDIR: "name a file",
    errno.EACCES: "choose another place, or change who may read and write there",
    errno.EPERM: "choose another place, or change who may read and write there",
    errno.EROFS: "choose another place",
}

# What the core says of a motion that is not finite, or of a matrix that is made from one
DIVERGED = ("not finite", "not positive definite")


POINT = "\n  - "  # begins each point that the message of a GroundError lists


class GroundError(Described, Exception):
    """Something is wrong with the user's files or arguments; the message says what, where and why.

    >>> try:
    ...     ground.fit(model_file, bag, free=["mass"])
    ... except ground.GroundError as error:
    ...     print(error)
    the model has no parameter 'mass'; it has m l I_z X_u Y_v N_r k
    """


class OptionError(GroundError):
    """An argument that does not fit the others, or has an invalid value.

    The message names arguments as Python does; `as_options` names them as the command line does.

    Parameters
    ----------
    text : str
        The message, with {0}, {1} for the names of arguments, and {name} for `values`.
    *names : str
        Names of arguments.
    **values
        Values for the named placeholders of the text.

    Examples
    --------
    >>> try:
    ...     ground.simulate(model_file, "prbs", burst=2)
    ... except ground.OptionError as error:
    ...     print(error, "|", error.as_options)
    burst needs room | --burst needs --room
    """

    def __init__(self, text: str, *names: str, **values: object) -> None:
        super().__init__(text.format(*names, **values))
        options = ["--" + name.replace("_", "-") for name in names]
        self.as_options = text.format(*options, **values)


class Diverged(GroundError):
    """The motion of a model, or what is computed from it, is not finite. A search takes this as an answer and
    goes on; other errors are the user's to mend."""


class GroundWarning(Described, UserWarning):
    """Something valid that is probably a mistake.

    >>> import warnings
    >>> heavy = ground.Model.load(model_file).with_values({"m": 58.3})
    >>> _ = heavy.save("heavy.yaml")
    >>> with warnings.catch_warnings(record=True) as said:
    ...     warnings.simplefilter("always", ground.GroundWarning)
    ...     _ = ground.Model.load("heavy.yaml")
    >>> "58.3" in str(said[0].message)
    True
    """

    PREFIX = "warning: "  # prefix on the command line


class GroundNote(GroundWarning):
    """What a user should know about a result."""

    PREFIX = "note: "


class RecordingWarning(GroundWarning):
    """Something odd in a recording; the message begins with its path."""

    PREFIX = ""


def core_error(error: Exception, where: str = "") -> GroundError:
    """What the core refuses, as Diverged if its text says that something is not finite, else as GroundError.
    where: begins the message."""
    text = ": ".join(filter(None, (where, str(error))))
    return Diverged(text) if any(words in text for words in DIVERGED) else GroundError(text)


@contextlib.contextmanager
def core_errors() -> Iterator[None]:
    """Raises what the core refuses inside the block as core_error does."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise core_error(error) from None


@contextlib.contextmanager
def warnings_as_lines() -> Iterator[None]:
    """Prints GroundWarnings inside the block on standard error, one line each, every text once."""
    shown: Set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("always", GroundWarning)
        usual = warnings.showwarning

        def show(message: Any, category: Type[Warning], *where: Any, **options: Any) -> None:
            if issubclass(category, GroundWarning):
                if str(message) in shown:
                    return
                shown.add(str(message))
                say("%s%s" % (category.PREFIX, message), sys.stderr)
            else:
                usual(message, category, *where, **options)

        warnings.showwarning = show
        yield


def guarded(name: str, work: Callable[[], int], debug: bool = False, look: str = "%s") -> int:
    """The exit status of work(); a failure becomes one line on standard error and status 1.

    name: the program's, at the beginning of the line. debug: prints the traceback as well, as does the
    environment variable GROUND_DEBUG. look: of the line, with %s
    for it. argparse's SystemExit passes through.
    """
    with contextlib.suppress(AttributeError, ValueError):  # a stream of another kind
        sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[attr-defined]
    try:
        status = work()
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        pass  # the reader of the output has gone, such as head
    except (Exception, KeyboardInterrupt) as error:
        if debug or os.environ.get("GROUND_DEBUG"):
            traceback.print_exc()
        print(look % harmless("%s: %s" % (name, sentence(error))), file=sys.stderr, flush=True)
    with contextlib.suppress(OSError, ValueError):
        _flush_or_drop(sys.stdout)
    return 1


def sentence(error: BaseException) -> str:
    """What a failure means to the user, in one line, and a line for each point that it lists."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, MemoryError):
        return "this computer does not have enough memory; take fewer or shorter runs"
    if isinstance(error, OSError) and error.errno is not None:
        names = [str(n) for n in (error.filename, error.filename2) if n is not None]
        return ": ".join(names + [reason(error)])
    if isinstance(error, GroundError):
        return POINT.join(" ".join(part.split()) for part in str(error).split(POINT))
    text = " ".join(str(error).split())
    return "unexpected %s: %s; --debug shows where" % (type(error).__name__, text or "no reason")


def reason(error: OSError) -> str:
    """Why the operating system refused, and what to do about it."""
    why = error.strerror or str(error)
    advice = ADVICE.get(error.errno or 0)
    return "%s; %s" % (why, advice) if advice else why


def add_debug(parser: argparse.ArgumentParser) -> None:
    """Adds --debug to an argparse parser."""
    parser.add_argument("--debug", action="store_true", help="show where it failed (also: GROUND_DEBUG=1)")


def _flush_or_drop(stream: TextIO) -> None:
    """Flushes a stream. If its reader has gone, the rest is dropped without a complaint at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def warn(text: str, category: Type[GroundWarning] = GroundWarning) -> None:
    """Gives a GroundWarning at the line that called the package."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").startswith("ground."):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def did_you_mean(word: str, known: Iterable[str], least: float = 0.6) -> str:
    """ " (did you mean motor_lag?)" for a word that is nearly one of the known ones, else nothing. least: how
    near, 1 for the same."""
    near = difflib.get_close_matches(word, list(known), 1, least)
    return " (did you mean %s?)" % near[0] if near else ""
