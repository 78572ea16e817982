"""The first lines of a result: what was found, how large it is, where it is kept, and what to do next."""

import textwrap
from typing import Iterable, Iterator, Tuple

# A label, and a text. Its first line is prose; each further one is a command, which is not wrapped. An empty
# label continues the line before.
Line = Tuple[str, str]

LABEL = 23  # width of the labels [characters]
WIDTH = 100  # of a line of prose, with its label


def formatted(lines: Iterable[Line]) -> Iterator[str]:
    """The lines as a terminal shows them."""
    for label, text in lines:
        prose, *commands = text.split("\n")
        head = (label + ": " if label else "").ljust(LABEL)
        yield from textwrap.wrap(
            prose, WIDTH, initial_indent=head, subsequent_indent=" " * LABEL, break_on_hyphens=False
        )
        yield from ("    " + command for command in commands)
