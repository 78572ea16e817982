#!/usr/bin/python3
"""Fuzzes the inputs of the Python package: exports (csv), bags (bag), MCAP files (mcap), mappings of tables
(mapping), options (options), definitions of messages (definitions), packets of Motive (packets), YAML of
runs and gains (yaml), and what comes to the viewer's port (websocket).

Every defect must be reported as a GroundError or as bad usage; anything else is a crash. The first
argument chooses the input; the others are libFuzzer's.
"""

import contextlib
import functools
import io
import os
import socket
import sys
import tempfile

import atheris

with atheris.instrument_imports(include=["ground"]):
    from ground import cli
    from ground.checks import quality
    from ground.data import import_csv
    from ground.draft import drafts
    from ground.exporting import viewers
    from ground.mocap import natnet
    from ground.reading import (
        bags,
        containers,
        decoding,
        definitions,
        mapping,
        readers,
        run_settings,
        streams,
    )
    from ground.simulation import gains
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


def mcap(data):
    """Reads an MCAP file as a recording, and all its tables."""
    name = path("any.mcap", data)
    with contextlib.suppress(GroundError):
        quality.repaired(readers.read(name))
    with contextlib.suppress(GroundError), bags.Bag(name) as found:
        for topic in found.topics:
            with contextlib.suppress(GroundError):
                found.table(topic)


def mapped(data):
    """Reads a table by a mapping, and drafts a mapping of it; a zero byte separates mapping and table."""
    first, _, second = data.partition(b"\0")
    table = path("table.csv", second)
    with contextlib.suppress(GroundError):
        quality.repaired(readers.read(table, mapping.load(path("mapping.yaml", first))))
    with contextlib.suppress(GroundError), containers.Tables([table]) as found:
        drafts.draft(found, in_folder=False)


def plain_yaml(data):
    """Reads YAML as a file of gains, as the parameters of a run, and as a file kept with a run."""
    with contextlib.suppress(GroundError):
        gains.read(path("gains.yaml", data))
    path("run.yaml", data)
    for _, parameters in run_settings.beside(os.path.join(FOLDER.name, "run.bag"), []):
        list(run_settings.nodes(parameters, "controller"))
        if isinstance(parameters, dict):
            run_settings.contents(parameters)
    run_settings.RunFile("a.yaml", data.decode("utf-8", "replace")).describe()


FRAMES = contextlib.ExitStack()  # the server of the viewer
HELLO = (
    b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)


@functools.lru_cache(maxsize=None)
def port():
    """Port of a server of a viewer."""
    return FRAMES.enter_context(viewers.served(viewers.context(), "fuzz", "127.0.0.1", 0)).port


def websocket(data):
    """Sends bytes to the viewer's port, after a greeting or in its place; the server then still greets."""
    greeted = data[:1] < b"\x80"
    for sent, answered in ((HELLO * greeted + data[1:], False), (HELLO, True)):
        with socket.create_connection(("127.0.0.1", port()), timeout=10) as line:
            with contextlib.suppress(ConnectionError):
                line.sendall(sent)
                line.shutdown(socket.SHUT_WR)
            if answered and b"101 Switching" not in line.recv(4096):
                raise AssertionError("the server of the viewer does not answer any more")


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
    words = ["diagnose", short_bag(), "--model", ROOT + "/cfg/hovercraft/tiny_whoover.yaml", "-o", "out"]
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
    targets = {
        "csv": csv, "bag": bag, "mcap": mcap, "mapping": mapped, "options": options,
        "definitions": definition, "packets": packets, "yaml": plain_yaml, "websocket": websocket,
    }  # fmt: skip
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
