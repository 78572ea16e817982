"""Completion of command lines by argcomplete: verbs, options, choices, effects and files.

A shell asks by running the program with _ARGCOMPLETE in its environment. Only the modules of the verb
on the line are loaded, because a user waits for the answer.
"""

import argparse
import os
from typing import Any, Callable, Iterator, List, Optional, Sequence

ParserOf = Callable[[Optional[Sequence[str]]], argparse.ArgumentParser]


def answer(parser_of: ParserOf) -> None:
    """Prints completions and ends the program, if a shell asks for them. parser_of: gives the parser with
    the options of the verbs among some words."""
    if "_ARGCOMPLETE" not in os.environ:
        return
    import argcomplete

    parser = parser_of(os.environ.get("COMP_LINE", "").split())
    for action in _actions(parser):
        if action.metavar == "EFFECT":
            action.completer = effects
    argcomplete.autocomplete(parser, always_complete_options=False)


def _actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """All actions, of verbs, too."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for verb in action.choices.values():
                yield from _actions(verb)


def effects(prefix: str, **_: Any) -> List[str]:
    """Names of effects of the library, and files of a user's own."""
    from argcomplete.completers import FilesCompleter

    from ground import _core

    return [*_core.effects(), *FilesCompleter(["yaml"])(prefix)]
