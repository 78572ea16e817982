"""What a draft cannot decide: the comment of such a line has MARK. A draft without such lines is complete."""

import re
from typing import List

from ground.reading import units
from ground.reading.mapping import UNDECIDED

MARK = UNDECIDED  # before a guess without evidence
AXES = re.compile(r'(# )?axes: "(.*)"  # %s.*' % MARK)
CLEAR = ("mostly", "clearly")  # a height that says which way is up, instead of one that is near 0
SEEN = 'axes: "%s"  # so left and right turn the craft as it moves'


def lines(text: str) -> List[str]:
    """The lines of a draft that somebody has to decide."""
    return [*dict.fromkeys(line.strip() for line in text.splitlines() if MARK in line)]


def is_height_clear(text: str) -> bool:
    """Whether a height says which way is up, of a draft whose frame alone is undecided."""
    found = AXES.search(text)
    return bool(found and " is %s " % CLEAR[1] in found.group())


def either_way_up(text: str) -> List[str]:
    """A draft with its frame either way up, its own guess first, where nothing else is undecided; itself if
    it is complete; empty where somebody has to decide."""
    found = AXES.search(text)
    if not found or len(lines(text)) > 1:
        return [] if lines(text) else [text]
    both = found.group(2), units.upside_down(found.group(2))
    return [text.replace(found.group(), SEEN % axes) for axes in both]
