"""Numbers, lists and sentences as text."""

from typing import List, Optional


def number(value: Optional[float]) -> str:
    """Three digits after the point; "-" for None."""
    return "-" if value is None else "%.3f" % value


def listed(names: List[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + names[-1:])


def capital(text: str) -> str:
    """A text with a capital letter."""
    return text[:1].upper() + text[1:]


def sentence(text: str) -> str:
    """A text with a capital letter and a full stop."""
    return capital(text.strip()) + ("" if text.rstrip().endswith((".", "!", "?")) else ".")
