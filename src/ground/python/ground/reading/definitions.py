"""Definitions of the types of messages: those that a bag holds, those that a user gives, and the usual ones.

rosbags' grammar parses them; nothing of a definition becomes code.
"""

import os
import pathlib
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List, Sequence, Tuple

from ground.reading.decoding import TIMES, Node, Types
from ground.reading.streams import ENCODINGS, Stream, plain
from ground.support.errors import GroundError, reason

SUFFIXES = (".msg", ".idl")
SKIPPED = ("build", "install", "log", "devel", "node_modules")  # folders that repeat a workspace's source


class Definitions:
    """The files with definitions of types that a user gives. GroundError for a path that has none."""

    def __init__(self, paths: Sequence[str] = ()) -> None:
        self.paths = tuple(paths)
        self._files: Dict[str, List[str]] = {}  # by the name of the type without its package
        for path in paths:
            found = list(_files(path))
            if not found:
                raise GroundError(
                    "%s: contains no .msg file; --types needs such files, or folders of them" % path
                )
            for file in found:
                self._files.setdefault(pathlib.Path(file).stem, []).append(file)

    def file(self, kind: str) -> str:
        """The file that defines a type ("ff_msgs/msg/Command"): its package's file, else the only file
        of this name; empty if there is none. GroundError if several files fit."""
        package, name = kind.split("/")[0], kind.rsplit("/", 1)[-1]
        files = list(dict.fromkeys(self._files.get(name, [])))
        own = [file for file in files if package in pathlib.Path(file).absolute().parts[-3:-1]] or files
        if len({_text(file) for file in own}) > 1:
            raise GroundError(
                "%s is defined differently in %s: choose one of them with --types"
                % (plain(kind), " and ".join(own))
            )
        return own[0] if own else ""

    def parsed(self, kind: str) -> Types:
        """The fields of a type by the files; empty when none defines it. GroundError for a damaged file."""
        file = self.file(kind)
        if not file:
            return {}
        try:
            return _parsed(_text(file), kind, "idl" if file.endswith(".idl") else "msg")
        except Exception as error:  # rosbags' parsers raise many kinds
            raise GroundError("%s: not a type definition (%s)" % (file, said(error)))


NONE = Definitions()


def said(error: object) -> str:
    """What an error of a library says, in one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _files(path: str) -> Iterator[str]:
    if not os.path.isdir(path):
        if not os.path.exists(path):
            raise GroundError("%s: no such file; --types needs .msg files, or folders of them" % path)
        yield from [path] if path.endswith(SUFFIXES) else []
        return
    for folder, inside, names in os.walk(path):
        inside[:] = sorted(i for i in inside if not i.startswith(".") and i not in SKIPPED)
        yield from (os.path.join(folder, name) for name in sorted(names) if name.endswith(SUFFIXES))


def _text(path: str) -> str:
    try:
        with open(path, encoding="utf-8-sig") as file:
            return file.read()
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except UnicodeDecodeError:
        raise GroundError("%s: not a type definition: not UTF-8" % path)


def _parsed(text: str, kind: str, form: str) -> Types:
    """The types in a definition, as bags hold it: with those that it needs, after lines of =."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    line = "=" * 80 + "\n"
    found: Types = {}
    if text.startswith(line + "IDL: "):
        for part in text.split(line)[1:]:
            found.update(get_types_from_idl(part.split("\n", 1)[1]))
    elif text:
        found.update(get_types_from_idl(text) if form == "idl" else get_types_from_msg(text, kind))
    return found


def _usual(is_ros1: bool) -> Types:
    from rosbags.typesys.stores import ros1_noetic, ros2_humble

    found = dict(ros1_noetic.FIELDDEFS if is_ros1 else ros2_humble.FIELDDEFS)
    found.update((name, of) for name, of in ros2_humble.FIELDDEFS.items() if name in TIMES)
    return found


def types_of(stream: Stream, given: Definitions = NONE) -> Types:
    """Descriptions of the types of a stream by name: those that the file defines, those that the user gives,
    and the usual ones. GroundError for a definition that is none, and for a type that nothing defines."""
    found, kind = _usual(stream.encoding == "ros1"), stream.kind
    try:
        held = _parsed(stream.definition, kind, stream.form)
    except Exception as error:  # rosbags' parsers raise many kinds
        raise GroundError(
            "%s: the definition of %s in the file is damaged (%s)" % (stream.topic, kind, said(error))
        )
    found.update(held)
    waiting, seen = [kind], set(held)
    while waiting:
        name = waiting.pop()
        found.update({} if name in held else given.parsed(name))
        if name not in found:
            raise GroundError(_undefined(stream, name, given))
        seen.add(name)
        waiting += [inner for inner in _named(found[name][1]) if inner not in seen]
    return found


def is_undefined(stream: Stream, given: Definitions) -> bool:
    """Whether nothing defines the type of a stream."""
    known = (
        stream.definition
        or stream.encoding not in ENCODINGS
        or stream.kind in _usual(stream.encoding == "ros1")
    )
    return not known and not given.file(stream.kind)


def is_given(stream: Stream, given: Definitions) -> str:
    """The file of the user by which a stream is read; empty where the file itself defines its type."""
    return "" if stream.definition else given.file(stream.kind)


def _named(fields: Sequence[Tuple[str, Node]]) -> Iterator[str]:
    """Types that the fields of a type have."""
    for _, (node, of) in fields:
        while node > 2:
            node, of = of[0]
        if node == 2:
            yield str(of)


def _undefined(stream: Stream, name: str, given: Definitions) -> str:
    """What is missing, and what to do."""
    needed = "" if name == stream.kind else ", which needs %s" % plain(name)
    without = "; %s has no %s.msg" % (", ".join(given.paths), name.rsplit("/", 1)[-1]) if given.paths else ""
    return (
        "topic %s has messages of type %s%s, whose definition is not in the file: give its .msg file, "
        "or a folder with it, with --types, or with types in a mapping%s"
    ) % (stream.topic, plain(stream.kind), needed, without)


def check_digest(stream: Stream, types: Types, file: str) -> None:
    """GroundError where the bag has a hash of a type, and the definition in a file has another one."""
    from rosbags.typesys.store import Typestore

    if not stream.digest.startswith("RIHS01_"):
        return
    # The method takes the fields of the store only. To register them would make code of the definition.
    store: Any = SimpleNamespace(fielddefs=types)
    if Typestore.hash_rihs01(store, stream.kind) != stream.digest:
        raise GroundError(
            "%s: it does not define %s as topic %s has it: the bag holds the hash of another definition; "
            "use the definition from when it was recorded" % (file, plain(stream.kind), stream.topic)
        )
