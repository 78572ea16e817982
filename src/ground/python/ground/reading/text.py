"""The lines of text files of any encoding and end of lines, packed or not."""

import gzip
import zlib
from typing import List

from ground.reading import damaged

MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}  # of encodings


def lines_of(path: str, notes: List[str]) -> List[str]:
    """The lines of a file, whatever its encoding and ends of lines."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error):
            notes.append("the compressed file is damaged: read as far as it goes")
            data, _ = damaged.unpacked(data, "gzip")
    wide = data[1:400:2].count(0) > 0.8 * len(data[1:400:2]) > 0
    encoding = next((found for mark, found in MARKS.items() if data.startswith(mark)), "")
    try:
        text = data.decode(encoding or ("utf-16-le" if wide else "utf-8"))
    except UnicodeDecodeError:
        text = data.decode("cp1252", "replace")
    if "\0" in text:
        notes.append("bytes of value 0 are left out (%d), as after a power loss" % text.count("\0"))
        text = text.replace("\0", "")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
