"""Reads what is whole in bags that are cut, damaged or were never closed, and messages of ROS 1 in MCAP.

A chunk that was cut is unpacked as far as it goes; one that is damaged is left out and counted. Formats: bags
of ROS 1 (wiki.ros.org/Bags/Format/2.0) and MCAP (mcap.dev/spec).
"""

import bz2
import contextlib
import importlib
import io
import os
import struct
import zlib
from dataclasses import replace
from typing import Any, BinaryIO, Callable, Dict, Iterator, List, Sequence, Tuple, Union

from ground.reading.streams import Row, Source, Stream

LARGE = 1 << 16  # bytes from which it is checked that so many are left
PIECE = 4096  # bytes that are unpacked at once

Message = Tuple[int, int, bytes]  #: key of its stream, time of receipt [ns], content
Found = Union[Stream, Message, str]  #: a str is a warning


class Damaged(Source):
    """What a scan of a file finds: streams, messages and warnings in any order."""

    def __init__(self, path: str, scan: Callable[[BinaryIO], Iterator[Found]]) -> None:
        super().__init__()
        self._path, self._scan = path, scan
        streams: Dict[int, Stream] = {}
        counts: Dict[int, int] = {}
        for found in self._found():
            if isinstance(found, Stream):
                streams.setdefault(found.key, found)
            elif isinstance(found, str):
                self.warnings.append(found)
            else:
                counts[found[0]] = counts.get(found[0], 0) + 1
        for key, stream in streams.items():
            self.streams.append(replace(stream, count=counts.get(key, 0)))

    def _found(self) -> Iterator[Found]:
        with open(self._path, "rb") as file:
            yield from self._scan(file)

    def messages(self, streams: Sequence[Stream]) -> Iterator[Row]:
        """See Source."""
        keys = {stream.key for stream in streams}
        for found in self._found():
            if isinstance(found, tuple) and found[0] in keys:
                yield found[1:]


def unpacked(data: bytes, compression: str) -> Tuple[bytes, bool]:
    """The content of a chunk or file, as far as it can be unpacked, and whether that is all."""
    if compression in ("", "none"):
        return data, True
    parts: List[bytes] = []
    try:
        unpack = _unpacker(compression)
        for at in range(0, len(data), PIECE):
            parts.append(unpack.decompress(data[at : at + PIECE]))
            if unpack.eof:
                break
        is_whole = bool(unpack.eof)
    except Exception:  # the libraries raise errors of their own
        is_whole = False
    return b"".join(parts), is_whole


def _unpacker(compression: str) -> Any:
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "gzip":
        return zlib.decompressobj(16 + zlib.MAX_WBITS)
    if compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor()
    for name in ("compression.zstd", "backports.zstd"):
        with contextlib.suppress(ImportError):
            return importlib.import_module(name).ZstdDecompressor()
    return importlib.import_module("zstandard").ZstdDecompressor().decompressobj()


def _up_to(file: BinaryIO, count: int) -> bytes:
    """So many bytes, or those that are left: a damaged count may be larger than memory."""
    if count > LARGE:
        here = file.tell()
        count = min(count, file.seek(0, os.SEEK_END) - here)
        file.seek(here)
    return file.read(count)


def _exactly(file: BinaryIO, count: int) -> bytes:
    """EOFError where there are fewer bytes."""
    data = _up_to(file, count)
    if len(data) < count:
        raise EOFError(data)
    return data


ENDS = "the bag is damaged or was not closed: read as far as it goes"
LEFT_OUT = "the bag is damaged: chunks that cannot be unpacked were left out (%d)"


def ros1(file: BinaryIO) -> Iterator[Found]:
    """What is in a bag of ROS 1."""
    file.readline()
    lost, is_closed, ends = 0, True, False
    try:
        while True:
            start = file.read(1)
            if not start:
                break
            file.seek(-1, os.SEEK_CUR)
            fields, size = _header(file)
            kind = fields.get(b"op", b"")
            if kind == b"\x03":
                is_closed = any(fields.get(b"index_pos", b""))
            data = _up_to(file, size)
            ends = len(data) < size
            if kind == b"\x05":
                content, is_whole = unpacked(data, fields.get(b"compression", b"").decode("latin-1"))
                if is_whole or ends:
                    yield from _of_chunk(content)
                else:
                    lost += 1
            elif kind == b"\x07" and not ends:
                yield from _connection(fields, data)
            if ends:
                break
    except (EOFError, ValueError, struct.error):
        ends = True
    if ends or not is_closed:
        yield ENDS
    if lost:
        yield LEFT_OUT % lost


def _of_chunk(content: bytes) -> Iterator[Found]:
    """The records in a chunk of ROS 1 that may end early."""
    file = io.BytesIO(content)
    try:
        while file.tell() < len(content):
            fields, size = _header(file)
            data = _exactly(file, size)
            if fields.get(b"op") == b"\x07":
                yield from _connection(fields, data)
            elif fields.get(b"op") == b"\x02":
                (key,) = struct.unpack("<I", fields[b"conn"])
                seconds, rest = struct.unpack("<II", fields[b"time"])
                yield key, seconds * 10**9 + rest, data
    except (EOFError, KeyError, ValueError, struct.error):
        pass


def _header(file: BinaryIO) -> Tuple[Dict[bytes, bytes], int]:
    """The fields of a record of ROS 1, and the size of its data."""
    (size,) = struct.unpack("<I", _exactly(file, 4))
    fields = _fields(_exactly(file, size))
    (size,) = struct.unpack("<I", _exactly(file, 4))
    return fields, size


def _fields(data: bytes) -> Dict[bytes, bytes]:
    found, at = {}, 0
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        name, equals, value = data[at + 4 : at + 4 + size].partition(b"=")
        if not equals:
            raise ValueError("a field without a value")
        found[name] = value
        at += 4 + size
    return found


def _connection(fields: Dict[bytes, bytes], data: bytes) -> Iterator[Stream]:
    of = _fields(data)
    kind, topic = (of.get(n, b"").decode("utf-8", "replace") for n in (b"type", b"topic"))
    topic = fields.get(b"topic", b"").decode("utf-8", "replace") or topic
    (key,) = struct.unpack("<I", fields[b"conn"])
    text = of.get(b"message_definition", b"").decode("utf-8", "replace")
    yield Stream(key, topic, _ros2_name(kind), "ros1", "msg", text)


def _ros2_name(kind: str) -> str:
    return kind if kind.count("/") != 1 else kind.replace("/", "/msg/")


class _Mcap:
    """The records of an MCAP file."""

    def __init__(self) -> None:
        self.schemas: Dict[int, Tuple[str, str, bytes]] = {0: ("", "", b"")}
        self.lost = 0
        self.ends = True

    def scan(self, file: BinaryIO, is_chunk: bool = False) -> Iterator[Found]:
        """What is in a file, or in a chunk, that may end early."""
        while True:
            start = file.read(9)
            if len(start) < 9 or start[0] == 0:
                return
            kind, size = start[0], int.from_bytes(start[1:], "little")
            data = _up_to(file, size)
            if len(data) < size and kind != 6:
                return
            if kind in (2, 15):  # footer, end of data
                self.ends = False
                return
            try:
                yield from self._record(kind, data, len(data) == size and not is_chunk)
            except (struct.error, IndexError, KeyError, UnicodeDecodeError):
                self.lost += 1

    def _record(self, kind: int, data: bytes, is_whole: bool) -> Iterator[Found]:
        if kind == 3:
            (key,) = struct.unpack_from("<H", data)
            name, at = _text(data, 2)
            form, at = _text(data, at)
            self.schemas[key] = name, form, data[at + 4 :]
        elif kind == 4:
            key, schema = struct.unpack_from("<HH", data)
            topic, at = _text(data, 4)
            encoding, at = _text(data, at)
            yield _channel(key, topic, encoding, *self.schemas[schema])
        elif kind == 5:
            key, _, time = struct.unpack_from("<HIQ", data)
            yield key, time, data[22:]
        elif kind == 6:
            yield from self._chunk(data, is_whole)

    def _chunk(self, data: bytes, is_whole: bool) -> Iterator[Found]:
        checksum, compression, at = struct.unpack_from("<I", data, 24)[0], *_text(data, 28)
        content, is_unpacked = unpacked(data[at + 8 :], compression)
        if is_whole and (not is_unpacked or checksum not in (0, zlib.crc32(content))):
            self.lost += 1
            return
        yield from self.scan(io.BytesIO(content), is_chunk=True)


def _text(data: bytes, at: int) -> Tuple[str, int]:
    """A text of MCAP, and where it ends."""
    (size,) = struct.unpack_from("<I", data, at)
    return data[at + 4 : at + 4 + size].decode("utf-8"), at + 4 + size


def _channel(key: int, topic: str, encoding: str, name: str, form: str, definition: bytes) -> Stream:
    is_text = form in ("ros1msg", "ros2msg", "ros2idl")
    text = definition.decode("utf-8", "replace") if is_text else ""
    return Stream(key, topic, _ros2_name(name), encoding, "idl" if form == "ros2idl" else "msg", text)


def mcap(file: BinaryIO) -> Iterator[Found]:
    """What is in an MCAP file."""
    file.read(8)
    found = _Mcap()
    yield from found.scan(file)
    if found.ends:
        yield ENDS
    if found.lost:
        yield LEFT_OUT % found.lost
