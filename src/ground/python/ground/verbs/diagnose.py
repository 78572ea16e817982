"""identify diagnose: which physical effect is missing in a model."""

import argparse

from ground import workers
from ground.analysis import candidates, criteria
from ground.annotations import Document
from ground.api.recordings import Part
from ground.verbs import common


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    on_request = ", ".join(candidates.on_request())
    common.add_bag_arguments(parser)
    common.add_span_arguments(parser)
    parser.add_argument("--model", metavar="M.yaml", required=True, help="the model to diagnose")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    common.add_holdout_argument(parser)
    parser.add_argument(
        "--only",
        metavar="EFFECT",
        nargs="+",
        help="effects to try, of the library and of --effects (all but %s)" % on_request,
    )
    parser.add_argument(
        "--exclude", metavar="EFFECT", nargs="+", default=[], help="effects not to try"
    )
    parser.add_argument(
        "--effects",
        metavar="EFFECT",
        nargs="+",
        default=[],
        help="effects to try as well: your own, one in each FILE.yaml, as model files list them, or "
        "by name those of the library that are not tried by default (%s)" % on_request,
    )
    parser.add_argument(
        "--budget",
        type=common.count,
        metavar="N",
        help="number of effects to refit in each step, the most promising by a score test (%d)"
        % criteria.Criteria.refitted,
    )
    parser.add_argument(
        "--thorough",
        action="store_true",
        help="use all data, however long it takes: all windows, held-out errors of all effects, all runs for "
        "the next experiment and in the pictures",
    )
    parser.add_argument(
        "--room",
        metavar="ROOM.yaml",
        help="room of the next experiment (that of the first run that has one, else 4 x 4 m)",
    )
    common.add_misread_argument(parser)
    workers.add_scheduler_argument(parser)
    parser.add_argument("--force", action="store_true", help="overwrite results in the folder")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    # imported here because they are slow to load
    from ground.api import diagnosing
    from ground.reports import diagnosis_files, words

    work = arguments.work
    folder = diagnosis_files.Folder(arguments.output, arguments.force)
    problem = diagnosing.read_problem(
        arguments.model,
        common.reading(arguments, arguments.bags),
        common.reading(arguments, arguments.holdout),
        chosen=(arguments.only, arguments.exclude, arguments.effects),
        budget=arguments.budget,
        thorough=arguments.thorough,
        room=arguments.room,
        part=Part(arguments.start, arguments.end, arguments.all),
        work=work,
        as_recorded=arguments.as_recorded,
    )
    folder.prepare()

    def told(report: Document) -> None:
        for line in words.concluded(report):
            common.say(arguments, line)

    with workers.Workers(arguments.scheduler) as team:
        found = diagnosing.solve(problem, work, team, told)
    folder.write_numbers(found)
    for line in words.described(found.report):
        common.say(arguments, line)
    with work.stage(common.PAGE), common.page(folder.page, folder.numbers):
        folder.write_page(found)
    common.say(arguments, "")
    for path in folder.written:
        common.say(arguments, "written to %s" % path)
    result: Document = found.to_dict()
    return result
