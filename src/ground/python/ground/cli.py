"""The command lines: rosrun ground identify VERB, and programs of one verb, rosrun ground track."""

import argparse
import json
import sys
from types import ModuleType
from typing import Iterator, Optional, Sequence

from ground import errors, files, terminal, verbs


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Runs one verb of identify; exit status 0 done, 1 could not, 2 bad usage."""
    arguments, unknown = _parser().parse_known_args(argv)
    if unknown:  # prints the verb's usage, not that of all verbs
        arguments.refuse("unrecognized arguments: %s" % " ".join(unknown))
    return _run("identify " + arguments.verb, arguments)


def program(verb: ModuleType, argv: Optional[Sequence[str]] = None) -> int:
    """Runs a program with this verb only; exit status as for main."""
    parser = argparse.ArgumentParser(prog=verb.NAME, description=verb.SUMMARY)
    _configure(parser, verb)
    return _run(verb.NAME, parser.parse_args(argv))


def _run(name: str, arguments: argparse.Namespace) -> int:
    def work() -> int:
        with files.protect(_inputs(arguments)), errors.warnings_as_lines():
            try:
                with terminal.shown(name, arguments.progress) as arguments.work:
                    result = arguments.run(arguments)
            except errors.OptionError as error:
                arguments.refuse(error.as_options)
        if arguments.json:
            json.dump(files.plain(result), sys.stdout, indent=1, allow_nan=False)
            print()
        return 0

    return errors.guarded(name, work, arguments.debug)


OUTPUTS = {"output", "picture"}  # arguments that name files to write; all others name files to read


def _inputs(arguments: argparse.Namespace) -> Iterator[str]:
    """Every argument that could name a file to read; for FILE.csv:NAME=NUMBER also the file."""
    for name, value in vars(arguments).items():
        if name in OUTPUTS:
            continue
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str):
                yield text
                yield text.partition(":")[0]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="identify", description="Identifies the hovercraft from recordings."
    )
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB")
    subparsers.required = True
    for verb in verbs.ALL:
        sub = subparsers.add_parser(verb.NAME, help=verb.SUMMARY, description=verb.SUMMARY)
        _configure(sub, verb)
    return parser


def _configure(parser: argparse.ArgumentParser, verb: ModuleType) -> None:
    parser.set_defaults(run=verb.run, refuse=parser.error)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--progress",
        choices=terminal.HOWS,
        help="how work of over %g s is shown on standard error (bar on a terminal, else lines)"
        % terminal.QUIET,
    )
    errors.add_debug(parser)
    verb.configure(parser)
