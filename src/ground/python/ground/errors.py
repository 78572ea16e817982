"""What the programs say when they cannot do what they were asked: one line, and exit status 1."""
import contextlib
import errno
import os
import sys
import traceback

# What to do about failures of the system that a person can do something about.
ADVICE = {
    errno.ENOSPC: "make room, or name another folder",
    errno.EDQUOT: "make room, or name another folder",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EISDIR: "name a file",
    errno.EACCES: "choose another place, or change who may read and write there",
    errno.EPERM: "choose another place, or change who may read and write there",
    errno.EROFS: "choose another place",
}


class GroundError(Exception):
    """Something is wrong with the user's files or wishes; the message says what, where, and why."""


def guarded(name, work, debug=False):
    """The exit status of work(); a failure becomes one line on standard error and status 1.

    name: of the program, begins the line. debug: print the traceback as well; the environment variable
    GROUND_DEBUG asks for the same. What argparse exits with passes through.
    """
    with contextlib.suppress(AttributeError, ValueError):  # a stream that is none of Python's own
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = work()
        sys.stdout.flush()
        return status
    except BrokenPipeError:
        pass  # whoever read the output has gone, as head does
    except (Exception, KeyboardInterrupt) as error:
        if debug or os.environ.get("GROUND_DEBUG"):
            traceback.print_exc()
        print("%s: %s" % (name, sentence(error)), file=sys.stderr)
    with contextlib.suppress(OSError, ValueError):
        _flush_or_drop(sys.stdout)
    return 1


def sentence(error):
    """What a failure means to the user, in one line."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, MemoryError):
        return "the memory of this computer does not suffice; take fewer or shorter runs"
    if isinstance(error, OSError) and error.errno is not None:
        names = [str(n) for n in (error.filename, error.filename2) if n is not None]
        return ": ".join(names + [reason(error)])
    text = " ".join(str(error).split())
    if isinstance(error, GroundError):
        return text
    return "unexpected %s: %s; --debug shows where" % (type(error).__name__, text or "no reason")


def reason(error):
    """Why the system refused, with what to do about it; error: an OSError."""
    why = error.strerror or str(error)
    advice = ADVICE.get(error.errno)
    return "%s; %s" % (why, advice) if advice else why


def add_debug(parser):
    """Adds --debug to an argparse parser."""
    parser.add_argument(
        "--debug", action="store_true", help="show where it failed (also: GROUND_DEBUG=1)"
    )


def _flush_or_drop(stream):
    """Flushes a stream; when nobody takes what is left, the interpreter shall not complain at exit."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
