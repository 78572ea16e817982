"""Completion of command lines by argcomplete: verbs, options, effects, files by their suffixes.

A shell asks by running the program with _ARGCOMPLETE in its environment. Only the modules of the verb
on the line are loaded, because a user waits for the answer.
"""

import argparse
import os
import re
from typing import Any, Callable, Iterator, List, Optional, Sequence

ParserOf = Callable[[Optional[Sequence[str]]], argparse.ArgumentParser]
SUFFIX = re.compile(r"\.(bag|csv|png|yaml)$")
RECORDINGS = (".bag", ".mcap", ".db3", ".csv", ".parquet")


def answer(parser_of: ParserOf) -> None:
    """Prints completions and ends the program, if a shell asks for them. parser_of: gives the parser with
    the options of the verbs among some words."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    parser = parser_of(os.environ.get("COMP_LINE", "").split())
    for action in _actions(parser):
        _prepare(action)
    argcomplete.autocomplete(parser, always_complete_options=False)


def _actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """All actions, of verbs, too."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from _actions(verb)


def _prepare(action: Any) -> None:
    """Gives an action what completes its values, by how help names them."""
    from argcomplete.completers import DirectoriesCompleter, FilesCompleter

    name = action.metavar if isinstance(action.metavar, str) else ""
    suffix = SUFFIX.search(name)
    if name == "EFFECT":
        action.completer = effects
    elif name == "BAG":
        action.completer = FilesCompleter([end[1:] for end in RECORDINGS])
    elif name == "DIR":
        action.completer = DirectoriesCompleter()
    elif suffix:
        action.completer = FilesCompleter([suffix.group(1)])
    elif action.nargs != 0 and not action.choices:
        action.completer = nothing


def effects(prefix: str, **_: Any) -> List[str]:
    """Names of effects of the library, and files of a user's own."""
    from argcomplete.completers import FilesCompleter

    from ground import _core

    return [*_core.effects(), *FilesCompleter(["yaml"])(prefix)]


def nothing(**_: Any) -> List[str]:
    """Completes nothing, as for numbers; files would mislead."""
    return []
