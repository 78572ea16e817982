#!/usr/bin/python3
"""Fuzzes the inputs of the Python package: exports (csv), bags (bag), options (options), definitions of
messages (definitions), packets of Motive (packets).

Every defect must be reported as a GroundError or as bad usage; anything else is a crash. The first
argument chooses the input; the others are libFuzzer's.
"""

import contextlib
import io
import os
import sys
import tempfile

import atheris

with atheris.instrument_imports(include=["ground"]):
    from ground import cli
    from ground.data import import_csv
    from ground.mocap import natnet
    from ground.recordings import decoding, definitions, quality, readers, streams
    from ground.support.errors import GroundError

FOLDER = tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None)
ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../.."))
OPTIONS = [
    "--json", "--axes", "--from", "--to", "--all", "--progress", "off", "--holdout", "--only", "--exclude",
    "--effects", "--force", "motor_lag", "1", "0.5", "-3", "1e400", "nan", "x, y, z",
]  # fmt: skip


def path(name, data):
    full = os.path.join(FOLDER.name, name)
    with open(full, "wb") as file:
        file.write(data)
    return full


def csv(data):
    """Reads two exports, separated by a zero byte."""
    controls, _, poses = data.partition(b"\0")
    bag = os.path.join(FOLDER.name, "run.bag")
    with contextlib.suppress(GroundError):
        import_csv.write_bag(path("c.csv", controls), path("p.csv", poses), bag, force=True)
        quality.repaired(readers.read(bag))


def bag(data):
    with contextlib.suppress(GroundError):
        quality.repaired(readers.read(path("any.bag", data)))


def short_bag():
    """A bag that is readable, but too short for a diagnosis."""
    name = os.path.join(FOLDER.name, "short.bag")
    if not os.path.exists(name):
        with open(ROOT + "/test/fuzz/seeds/csv/exports", "rb") as file:
            controls, _, poses = file.read().partition(b"\0")
        import_csv.write_bag(path("c.csv", controls), path("p.csv", poses), name)
    return name


def options(data):
    provider = atheris.FuzzedDataProvider(data)
    words = [
        "diagnose",
        short_bag(),
        "--model",
        ROOT + "/cfg/hovercraft/tiny_whoover.yaml",
        "-o",
        "out",
    ]
    while provider.remaining_bytes() > 0 and len(words) < 12:
        if provider.ConsumeBool():
            words.append(provider.PickValueInList(OPTIONS))
        else:
            # a command line cannot contain a zero byte
            words.append(provider.ConsumeUnicodeNoSurrogates(12).replace("\0", ""))
    if "-h" in words or any(w.startswith("--h") for w in words):
        return
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        with contextlib.suppress(SystemExit):
            if cli.main(words) not in (0, 1):
                raise AssertionError("unknown exit status: %s" % words)


RUNS_CODE = {"compile", "exec", "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen"}
is_watched = False


def watch(event, _):
    """An audit hook: while definitions are parsed and followed, nothing may become code."""
    if is_watched and event in RUNS_CODE:
        raise AssertionError("a definition led to " + event)


def definition(data):
    """Parses a definition of ROS 1, ROS 2 or IDL, and decodes the bytes after the first zero by it."""
    global is_watched
    text, _, message = data[1:].partition(b"\0")
    is_ros1 = data[:1] < b"U"

    form = "idl" if data[:1] >= b"\xaa" else "msg"
    encoding = "ros1" if is_ros1 else "cdr"
    stream = streams.Stream(0, "/pose", "own_msgs/msg/Pose", encoding, form, text.decode("utf-8", "replace"))
    is_watched = True
    try:
        types = definitions.types_of(stream)
        decoding.Layouts(types, stream.kind, is_ros1).columns([message] * 3, "")
    except AssertionError as error:
        if "led to" in str(error):
            raise
    except Exception:  # callers expect errors of any kind
        pass
    finally:
        is_watched = False


def packets(data):
    """Reads a packet of Motive as each of its messages, in a version that the first bytes give."""
    version = (2 + data[0] % 3, data[1] % 12) if len(data) > 1 else natnet.NEWEST
    for read in (
        natnet.opened,
        natnet.server,
        natnet.streamed_version,
        lambda payload: natnet.models(payload, version),
        lambda payload: natnet.frame(payload, version, 10**7),
    ):
        with contextlib.suppress(natnet.PacketError):
            read(data[2:])


def main():
    targets = {"csv": csv, "bag": bag, "options": options, "definitions": definition, "packets": packets}
    if len(sys.argv) < 2 or sys.argv[1] not in targets:
        sys.exit("python_inputs: name one of %s" % ", ".join(targets))
    target = targets[sys.argv.pop(1)]
    for kind in (b"1", b"a"):  # imports what definitions need
        definition(kind + b"time stamp\0\0\1" + bytes(10))
    sys.addaudithook(watch)
    atheris.Setup(sys.argv, lambda data: target(data) and None)
    atheris.Fuzz()


if __name__ == "__main__":
    os.chdir(FOLDER.name)
    main()
