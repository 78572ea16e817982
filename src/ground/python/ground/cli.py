"""The command lines: rosrun ground identify VERB, and programs of one verb, rosrun ground track.

A module of a verb has configure(parser) and run(arguments); run returns what --json prints. It is loaded
when its verb is used: all of them take a third of a second.
"""

import argparse
import importlib
import itertools
import json
import os
import re
import sys
from typing import Any, Iterator, NamedTuple, NoReturn, Optional, Sequence

from ground.support import completion, errors, files, progress
from ground.support.errors import did_you_mean

INCOMPLETE = "the following arguments are required"  # begins what argparse says of them
OPTION = re.compile(r"--?[a-zA-Z]\S*$")  # a word that can be nothing else


class _Parser(argparse.ArgumentParser):
    """A parser that takes options by their whole names, and says in a line where they are listed."""

    def __init__(self, **more: Any) -> None:
        super().__init__(allow_abbrev=False, **more)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses the arguments after their options are known to exist, whatever else is wrong with them."""
        given = list(sys.argv[1:] if args is None else args)
        known = [one for action in self._actions for one in action.option_strings]
        for word in itertools.takewhile(self._is_own, given):
            name = word.split("=")[0] if word.startswith("--") else word[:2]
            if OPTION.match(word) and name not in known:
                wrong = word.split("=")[0]
                hint = did_you_mean(wrong, known, 0.7)
                self.error("there is no option %s%s" % (wrong, hint or self._form()))
        return super().parse_known_args(given, namespace)

    def _is_own(self, word: str) -> bool:
        """Whether the words up to this one are for this parser, not for a verb, and may be options."""
        return word != "--" and (self._subparsers is None or word.startswith("-"))

    def _form(self) -> str:
        """The shortest command line that is complete; empty for a parser of verbs."""
        if self._subparsers:
            return ""
        needed = [one for one in self._actions if one.required and one.nargs != "*"]
        words = [self.prog]
        for one in sorted(needed, key=lambda one: bool(one.option_strings)):
            words += [*one.option_strings[:1], str(one.metavar or one.dest) + " ..." * (one.nargs == "+")]
        return "; the form is " + (self.get_default("form") or " ".join(words))

    def error(self, message: str) -> NoReturn:
        if message.startswith(INCOMPLETE):
            message += self._form()
        self.exit(2, "%s: %s (%s --help lists the options)\n" % (self.prog, message, self.prog))


class _Version(argparse.Action):
    """Prints the version, which the core knows."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print("ground", importlib.import_module("ground._core").version)
        parser.exit()


class Verb(NamedTuple):
    """A verb of identify, or a program of one verb."""

    name: str
    module: str
    summary: str


WORKBENCH = Verb(
    "workbench", "workshop.workbench", "serves a page to fit a model, see where it fails, and add effects"
)
VERBS = [
    Verb("import", "data.import_csv", "converts CSV from rostopic echo -p to a bag"),
    Verb("info", "data.info", "reports contents, anomalies and usable parts of recordings"),
    Verb("bench", "fitting.bench", "fits thrust, its curve and gains to bench forces (thesis 3.2)"),
    Verb("simulate", "simulation.simulate", "records a simulated experiment to a bag, without ROS running"),
    Verb("fit", "fitting.fit", "fits a model's parameters to recordings by simulation error"),
    Verb("compare", "comparing.compare", "compares models with recordings: errors, their causes, pictures"),
    Verb("diagnose", "diagnosing.diagnose", "finds the physical effects that a model lacks, and adds them"),
    Verb("discover", "discovery.discover", "lets a simulated craft find its own physics"),
    Verb("add", "fitting.add", "adds an effect to a model, refits it, and shows the error before and after"),
    Verb("history", "ledger.history", "reports drifts, jumps and odd craft over many runs"),
    WORKBENCH,
    Verb("export", "exporting.export", "exports a model as NumPy, CasADi or C code; a run as MCAP"),
    Verb("tracking", "control.tracking", "reports how craft followed their reference"),
]
TRACK = Verb("track", "control.track", "drives a simulated craft along a reference, without ROS running")
TUNE = Verb("tune", "control.tune", "searches for the gains of a controller in closed loop, on all cores")
PROGRAMS = {verb.name: verb for verb in (TRACK, TUNE, WORKBENCH)}  # programs that are one verb


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Runs one verb of identify; exit status 0 done, 1 could not, 2 bad usage."""
    completion.answer(_parser)
    given = sys.argv[1:] if argv is None else argv
    words = [word for word in given if not word.startswith("-")]
    verbs = [verb.name for verb in VERBS]
    if not given:
        _parser([]).print_help(sys.stderr)
        return 2
    if words[:1] and words[0] not in verbs and given[0] == words[0]:
        hint = errors.did_you_mean(words[0], verbs)
        _parser([]).error("there is no verb %s%s; there are %s" % (words[0], hint, ", ".join(verbs)))
    arguments, unknown = _parser(words[:1]).parse_known_args(argv)
    if unknown:  # prints the usage of the verb, not of all verbs
        arguments.refuse("unrecognized arguments: %s" % " ".join(unknown))
    return _run("identify " + arguments.verb, arguments)


def program(name: str, argv: Optional[Sequence[str]] = None) -> int:
    """Runs one of PROGRAMS; exit status as for main."""
    verb = PROGRAMS[name]

    def parser_of(_: Optional[Sequence[str]] = None) -> argparse.ArgumentParser:
        parser = _Parser(prog=name, description=verb.summary)
        _configure(parser, verb)
        return parser

    completion.answer(parser_of)
    return _run(name, parser_of().parse_args(argv))


def identify() -> int:
    """Entry point of identify; exit status as for main."""
    return errors.guarded("identify", main)


def track() -> int:
    """Entry point of track."""
    return errors.guarded("track", lambda: program("track"))


def tune() -> int:
    """Entry point of tune."""
    return errors.guarded("tune", lambda: program("tune"))


def workbench() -> int:
    """Entry point of workbench."""
    return errors.guarded("workbench", lambda: program("workbench"))


def _run(name: str, arguments: argparse.Namespace) -> int:
    def work() -> int:
        with files.protect(_inputs(arguments)), errors.warnings_as_lines():
            try:
                with progress.shown(name, arguments.progress) as arguments.work:
                    result = arguments.run(arguments)
                    if "drafted" in arguments:
                        importlib.import_module("ground.data.bag_arguments").store_drafts(arguments)
            except errors.OptionError as error:
                arguments.refuse(error.as_options)
        if arguments.json:
            json.dump(files.plain(result), sys.stdout, indent=1, allow_nan=False)
            print()
        return 0

    return errors.guarded(name, work, arguments.debug)


RECORDINGS = (".bag", ".mcap", ".db3", ".csv", ".parquet")  # ends of their names
# Arguments that name files to write; all others name files to read
OUTPUTS = {"output", "picture", "mat", "mcap"}


def _inputs(arguments: argparse.Namespace) -> Iterator[str]:
    """Every argument that could name a file to read, and the recordings in a folder; for
    FILE.csv:NAME=NUMBER also the file."""
    for name, value in vars(arguments).items():
        if name in OUTPUTS:
            continue
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str):
                yield text
                yield text.partition(":")[0]
                if os.path.isdir(text):
                    yield from (entry.path for entry in os.scandir(text) if entry.name.endswith(RECORDINGS))


def _parser(used: Optional[Sequence[str]] = None) -> argparse.ArgumentParser:
    """The parser of identify. used: names of the verbs whose options are needed (all)."""
    parser = _Parser(prog="identify", description="Identifies the hovercraft from recordings.")
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version of ground and exit")
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB")
    subparsers.required = True
    for verb in VERBS:
        sub = subparsers.add_parser(verb.name, help=verb.summary, description=verb.summary)
        if used is None or verb.name in used:
            _configure(sub, verb)
    return parser


def _configure(parser: argparse.ArgumentParser, verb: Verb) -> None:
    module = importlib.import_module("ground." + verb.module)
    parser.set_defaults(run=module.run, refuse=parser.error, work=progress.Work())
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--progress",
        choices=progress.HOWS,
        help="how work is shown on standard error (bar on a terminal, else lines)",
    )
    errors.add_debug(parser)
    module.configure(parser)
