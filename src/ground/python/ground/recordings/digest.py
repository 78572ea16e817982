"""Digests of contents, by which runs are told from each other: not by the names of their files."""

import functools
import hashlib
from typing import Iterable

BLOCK = 1 << 20  # bytes that are hashed at a time


def of_files(paths: Iterable[str]) -> str:
    """A digest of what files contain, whatever their names and order. Raises OSError when a file cannot
    be read."""
    return of_parts(sorted(of_file(path) for path in paths))


def of_parts(parts: Iterable[bytes]) -> str:
    """A digest of parts, in their order."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        add(digest, part)
    return digest.hexdigest()


def of_file(path: str) -> bytes:
    """A digest of what a file contains. Raises OSError when it cannot be read."""
    digest = hashlib.blake2b(digest_size=32)
    with open(path, "rb") as file:
        for block in iter(functools.partial(file.read, BLOCK), b""):
            digest.update(block)
    return digest.digest()


def add(digest: "hashlib._Hash", part: bytes) -> None:
    """Adds a part and its length, so that parts cannot be mistaken for others."""
    digest.update(b"%d:" % len(part))
    digest.update(part)
