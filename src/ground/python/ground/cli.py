"""The command lines: rosrun ground identify VERB, and programs of one verb, rosrun ground track."""

import argparse
import json
import sys
from typing import Iterator, Optional, Sequence

from ground import completion, errors, files, progress, verbs


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Runs one verb of identify; exit status 0 done, 1 could not, 2 bad usage."""
    completion.answer(_parser)
    given = sys.argv[1:] if argv is None else argv
    words = [word for word in given if not word.startswith("-")]
    arguments, unknown = _parser(words[:1]).parse_known_args(argv)
    if unknown:  # prints the verb's usage, not that of all verbs
        arguments.refuse("unrecognized arguments: %s" % " ".join(unknown))
    return _run("identify " + arguments.verb, arguments)


def program(verb: verbs.Verb, argv: Optional[Sequence[str]] = None) -> int:
    """Runs a program with this verb only; exit status as for main."""

    def parser_of(_: Optional[Sequence[str]] = None) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(prog=verb.name, description=verb.summary)
        _configure(parser, verb)
        return parser

    completion.answer(parser_of)
    return _run(verb.name, parser_of().parse_args(argv))


def _run(name: str, arguments: argparse.Namespace) -> int:
    def work() -> int:
        with files.protect(_inputs(arguments)), errors.warnings_as_lines():
            try:
                with progress.shown(name, arguments.progress) as arguments.work:
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


def _parser(used: Optional[Sequence[str]] = None) -> argparse.ArgumentParser:
    """The parser of identify. used: names of the verbs whose options are needed (all)."""
    parser = argparse.ArgumentParser(
        prog="identify", description="Identifies the hovercraft from recordings."
    )
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB")
    subparsers.required = True
    for verb in verbs.ALL:
        sub = subparsers.add_parser(verb.name, help=verb.summary, description=verb.summary)
        if used is None or verb.name in used:
            _configure(sub, verb)
    return parser


def _configure(parser: argparse.ArgumentParser, verb: verbs.Verb) -> None:
    module = verb.load()
    parser.set_defaults(run=module.run, refuse=parser.error, work=progress.Work())
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--progress",
        choices=progress.HOWS,
        help="how work is shown on standard error (bar on a terminal, else lines)",
    )
    errors.add_debug(parser)
    module.configure(parser)
