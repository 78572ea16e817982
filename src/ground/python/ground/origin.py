"""Provenance of a result: what is needed to reproduce it."""

import datetime
import hashlib
import os
import platform
import shlex
import sys
from importlib import metadata
from typing import Dict


def command() -> str:
    """The command line of this process."""
    name = os.path.basename(sys.argv[0])
    return " ".join([name] + [shlex.quote(a) for a in sys.argv[1:]])


def now() -> str:
    """The time in UTC, ISO 8601, to the second."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def versions() -> Dict[str, str]:
    """Versions of the programs used, by name."""
    from ground import _core

    found = {"ground": _core.version, "Ceres": _core.ceres_version, "Eigen": _core.eigen_version}
    libraries = ("numpy", "scipy", "scikit-learn", "plotly")
    found.update((name, metadata.version(name)) for name in libraries)
    found["Python"] = platform.python_version()
    return found


def fingerprint(path: str) -> str:
    """The first half of a SHA-256 that identifies the contents of a file, or the names and contents of the
    files in a folder."""
    digest = hashlib.sha256()
    inside = sorted(
        os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names
    )
    for name in inside:
        digest.update(os.path.relpath(name, path).encode())
    for name in inside or [path]:
        with open(name, "rb") as file:
            for part in iter(lambda: file.read(1 << 20), b""):
                digest.update(part)
    return digest.hexdigest()[:32]
