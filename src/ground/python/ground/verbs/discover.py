"""identify discover: a simulated craft finds its own physics."""

import argparse

from ground import command_line
from ground.annotations import Document
from ground.errors import GroundError
from ground.simulating.simulate import Acting, MOCAP, Mocap

DETAILS = """
The craft flies bursts of inputs in a room, without ROS and faster than real time. All flights so far
are diagnosed, the controllers take the improved model, and the next flight is the one that is
expected to tell most about the effects that are still open. When no question is left, a flight that
neither fit nor choice has seen confirms the result.

DIR keeps recordings, inputs, models, journal.json and, after each step, the page report.html. When
DIR has a discovery of the same model, it is continued. A disturbance in the file of the true model
acts only with --disturbance.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    parser.add_argument("--model", metavar="M.yaml", required=True, help="the model to begin with")
    parser.add_argument("--truth", metavar="T.yaml", required=True, help="true model of the craft")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder of the discovery")
    parser.add_argument("--room", metavar="ROOM.yaml", help="room in which it flies (4 x 4 m)")
    parser.add_argument(
        "--budget",
        type=command_line.positive,
        default=180.0,
        metavar="S",
        help="longest time of flight [s] (%(default)g)",
    )
    parser.add_argument(
        "--seed",
        type=command_line.seed,
        default=1,
        help="for the mocap's noise and losses, the disturbance, and the inputs (%(default)s)",
    )
    parser.add_argument(
        "--no-track",
        action="store_true",
        help="do not compare how the given and the final model track a reference",
    )
    command_line.add_options(parser, Acting)
    command_line.add_options(parser, Mocap)


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    # imported here because they are slow to load
    from ground.discovery import discover
    from ground.models import Model
    from ground.discovery.words import Teller

    model = Model.load(arguments.model)

    def say(text: str) -> None:
        command_line.say(arguments, text)

    try:
        found = discover.discover(
            model,
            arguments.truth,
            arguments.output,
            room=arguments.room,
            budget=arguments.budget,
            seed=arguments.seed,
            track=not arguments.no_track,
            mocap=command_line.given(arguments, MOCAP),
            disturbance=arguments.disturbance,
            trim=arguments.trim,
            told=Teller(say, model.core),
            progress=arguments.work,
        )
    except KeyboardInterrupt:
        raise GroundError("interrupted; the same command continues %s" % arguments.output)
    say("")
    for text in found.sentences:
        say(text)
    if found.story.needed:
        say("Needed: %s" % found.story.needed)
    say("written to %s" % found.page)
    return found.to_dict()
