"""The command lines: rosrun ground identify VERB, and programs of one verb, rosrun ground track."""
import argparse
import json
import os
import sys

from ground import files, verbs
from ground.errors import IdentifyError


def main(argv=None):
    """Runs one verb of identify; exit status 0 done, 1 could not, 2 bad usage."""
    arguments = _parser().parse_args(argv)
    return _run("identify " + arguments.verb, arguments)


def program(verb, argv=None):
    """Runs a program that has this verb only; exit status alike."""
    parser = argparse.ArgumentParser(prog=verb.NAME, description=verb.SUMMARY)
    _configure(parser, verb)
    return _run(verb.NAME, parser.parse_args(argv))


def _run(name, arguments):
    try:
        result = arguments.run(arguments)
    except IdentifyError as error:
        print("%s: %s" % (name, error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("%s: interrupted" % name, file=sys.stderr)
        return 1
    except BrokenPipeError:
        return _nobody_reads()
    try:
        if arguments.json:
            json.dump(files.plain(result), sys.stdout, indent=1, allow_nan=False)
            print()
        sys.stdout.flush()
    except BrokenPipeError:
        return _nobody_reads()
    return 0


def _nobody_reads():
    """Whoever read the output has gone, as head does; the interpreter shall not complain at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 1


def _parser():
    parser = argparse.ArgumentParser(
        prog="identify", description="Identifies the hovercraft from recordings."
    )
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB")
    subparsers.required = True
    for verb in verbs.ALL:
        sub = subparsers.add_parser(verb.NAME, help=verb.SUMMARY, description=verb.SUMMARY)
        _configure(sub, verb)
    return parser


def _configure(parser, verb):
    parser.set_defaults(run=verb.run)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    verb.configure(parser)
