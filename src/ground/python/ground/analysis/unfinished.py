"""Finished parts of a long computation, so that an interrupted one can be resumed.

Files contain data only: the SHA-256 of the rest, arrays (NumPy's npz without objects) and a JSON
tree that refers to them. Nothing in the folder is ever executed: a file that is damaged or foreign
is ignored, and its part is computed again.
"""

import contextlib
import dataclasses
import hashlib
import io
import json
import os
import re
import threading
import zipfile
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Type, TypeVar, cast

import numpy as np

from ground import _core, files
from ground.annotations import Array, Each
from ground.errors import GroundError

_T = TypeVar("_T")
_Item = TypeVar("_Item")

# Names of files written by this and earlier versions, and of those that files.new_file has left where it
# was killed
NAME = re.compile(r"[0-9a-f]{64}(\.npz)?|\.ground-\w+\.npz")
_classes: Dict[str, type] = {}  # full name -> dataclass


def can_be_kept(cls: Type[_T]) -> Type[_T]:
    """Decorates a dataclass whose objects may be in a result: fields of numbers, strings, arrays,
    models, lists, tuples and dictionaries of these, and other such classes."""
    _classes[_name_of(cls)] = cls
    return cls


def _name_of(cls: type) -> str:
    return "%s.%s" % (cls.__module__, cls.__name__)


class Unfinished:
    """Results of the parts of a computation, kept in a folder until all parts are done.

    folder: None keeps nothing. identity: everything that the results depend on, of types that can be
    kept; it distinguishes them from the results of other computations.
    """

    def __init__(self, folder: Optional[str] = None, identity: Any = None) -> None:
        self._folder = folder
        self._identity = _packed(identity) if folder else b""
        self._lock = threading.Lock()
        self.taken = 0  # number of results taken from an earlier run
        if folder:
            os.makedirs(folder, exist_ok=True)

    def result(self, part: Any, compute: Callable[[], _T]) -> _T:
        """Result of compute(), or of an earlier call; the repr of `part` identifies it."""
        (found,) = self.results([part], lambda _: compute(), [None], map)
        return found

    def results(
        self,
        parts: Sequence[Any],
        work: Callable[[_Item], _T],
        items: Sequence[_Item],
        each: Each,
    ) -> Iterator[_T]:
        """Results of work(item) for each item, or of an earlier call; the repr of each of `parts`
        identifies one. each: maps the work over the items that are left."""
        paths = [self._path(part) for part in parts]
        earlier = [self._earlier(path) for path in paths]
        fresh = iter(each(work, [item for item, e in zip(items, earlier) if not e]))
        for path, known in zip(paths, earlier):
            if known:
                yield cast(_T, known[0])
                continue
            found = next(fresh)
            self._keep(path, found)
            yield found

    def _path(self, part: Any) -> str:
        """Path of the file for a part; empty where nothing is kept."""
        if not self._folder:
            return ""
        name = hashlib.sha256(self._identity + repr(part).encode()).hexdigest()
        return os.path.join(self._folder, name + ".npz")

    def _earlier(self, path: str) -> List[Any]:
        """The result in a file, as a list; an empty one without it."""
        if not path:
            return []
        try:
            with open(path, "rb") as file:
                kept = _unpacked(file.read())
        except Exception:
            return []  # absent, damaged or foreign: parsing may raise anything
        with self._lock:
            self.taken += 1
        return [kept]

    def _keep(self, path: str, found: Any) -> None:
        # a result that cannot be kept is computed again next time
        with contextlib.suppress(GroundError, OSError):
            if path:
                with files.new_file(path, force=True) as temporary:
                    with open(temporary, "wb") as file:
                        file.write(_packed(found))

    def done(self) -> None:
        """Deletes the kept results; foreign files stay."""
        if not self._folder:
            return
        with contextlib.suppress(OSError):
            for name in os.listdir(self._folder):
                if NAME.fullmatch(name):
                    os.unlink(os.path.join(self._folder, name))
            os.rmdir(self._folder)


def _packed(value: Any) -> bytes:
    """The bytes of a file."""
    arrays: List[Array] = []
    tree = json.dumps(_tree(value, arrays)).encode()
    buffer = io.BytesIO()
    np.savez(buffer, np.frombuffer(tree, np.uint8), *arrays)
    return hashlib.sha256(buffer.getvalue()).digest() + buffer.getvalue()


def _unpacked(contents: bytes) -> Any:
    """The value in the bytes of a file; raises ValueError, or whatever parsing meets, if bad."""
    digest, contents = contents[:32], contents[32:]
    if hashlib.sha256(contents).digest() != digest:
        raise ValueError("the checksum is wrong")
    buffer = io.BytesIO(contents)
    with zipfile.ZipFile(buffer) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > len(contents):
            raise ValueError("the arrays are compressed")
    with np.load(buffer, allow_pickle=False) as found:
        arrays = [found["arr_%d" % i] for i in range(len(found.files))]
    return _value(json.loads(arrays[0].tobytes().decode()), arrays[1:])


def _tree(value: Any, arrays: List[Array]) -> Any:
    """A value as JSON; a type that JSON does not have is a map from its kind to its contents."""
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise TypeError("an array of objects cannot be kept")
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, (list, tuple)):
        return {type(value).__name__: [_tree(item, arrays) for item in value]}
    if isinstance(value, dict):
        return {"dict": [[_tree(k, arrays), _tree(v, arrays)] for k, v in value.items()]}
    if isinstance(value, _core.Model):
        return {"model": value.format()}
    name = _name_of(type(value))
    if _classes.get(name) is not type(value):
        raise TypeError("a %s cannot be kept" % name)
    fields = {f.name: _tree(getattr(value, f.name), arrays) for f in dataclasses.fields(value)}
    return {"object": [name, fields]}


def _value(tree: Any, arrays: Sequence[Array]) -> Any:
    """The reverse of _tree."""
    if not isinstance(tree, dict):
        return tree
    ((kind, contents),) = tree.items()
    if kind == "array":
        return arrays[contents]
    if kind == "dict":
        return {_value(k, arrays): _value(v, arrays) for k, v in contents}
    if kind == "model":
        return _core.parse_model(contents, "a result that was kept")
    if kind == "object":
        name, fields = contents
        return _classes[name](**{k: _value(v, arrays) for k, v in fields.items()})
    return {"list": list, "tuple": tuple}[kind](_value(item, arrays) for item in contents)
