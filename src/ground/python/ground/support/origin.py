"""Provenance of a result: what is needed to reproduce it."""

import datetime
import hashlib
import os
import platform
import shlex
import sys
from importlib import metadata
from typing import Iterable, List, Tuple


def command() -> str:
    """The command line of this process."""
    name = os.path.basename(sys.argv[0])
    return " ".join([name] + [shlex.quote(a) for a in sys.argv[1:]])


def now() -> str:
    """The time in UTC, ISO 8601, to the second."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def versions() -> str:
    """Versions of the programs used."""
    from ground import _core

    found = {"ground": _core.version, "Eigen": _core.eigen_version}
    libraries = ("numpy", "scipy", "scikit-learn", "plotly")
    found.update((name, metadata.version(name)) for name in libraries)
    found["Python"] = platform.python_version()
    return ", ".join("%s %s" % item for item in found.items())


def fingerprints(paths: Iterable[str]) -> List[Tuple[str, str]]:
    """Files or folders, each with its fingerprint."""
    return [(path, fingerprint(path)) for path in paths]


def fingerprint(path: str) -> str:
    """The first half of the SHA-256 of a file, or of the files in a folder and their names, which
    identifies the contents."""
    digest = hashlib.sha256()
    for one in _files(path):
        if one != path:
            digest.update(os.path.relpath(one, path).encode() + b"\0")
        with open(one, "rb") as file:
            for part in iter(lambda: file.read(1 << 20), b""):
                digest.update(part)
    return digest.hexdigest()[:32]


def _files(path: str) -> List[str]:
    """The file itself, or all files in a folder, in order of their names."""
    if not os.path.isdir(path):
        return [path]
    return sorted(os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names)
