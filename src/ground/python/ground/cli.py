"""The identification tool's command line: rosrun ground identify VERB."""
import argparse
import json
import os
import sys

from ground import files, verbs
from ground.errors import IdentifyError


def main(argv=None):
    """Runs one verb; exit status 0 done, 1 could not, 2 bad usage."""
    arguments = _parser().parse_args(argv)
    try:
        result = arguments.run(arguments)
    except IdentifyError as error:
        print("identify %s: %s" % (arguments.verb, error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("identify %s: interrupted" % arguments.verb, file=sys.stderr)
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
        sub.set_defaults(run=verb.run)
        sub.add_argument("--json", action="store_true", help="print the result as JSON")
        verb.configure(sub)
    return parser
