"""identify simulate: a recording of a simulated experiment."""

import argparse
import os
import sys
from typing import Iterator, Optional

from ground import _core, files
from ground.annotations import Document
from ground.api import simulating
from ground.api.models import Model
from ground.api.simulating import DESIGNS, DURATION, GAINS, KINDS, REFERENCE
from ground.recordings.run_settings import AXES
from ground.simulation import bag_writer
from ground.simulation import tracking as loop
from ground.simulation.experiments import SimulatedRun
from ground.verbs import common, conditions, listing

SIMULATING = "simulating"  # stage

DETAILS = (
    "\ninputs:\n"
    + "".join("  %-18s %s\n" % (name, info.text) for name, info in DESIGNS.items() if name in KINDS)
    + """  tracking           a controller follows a reference, by the poses that the mocap delivers
  FILE.csv           bits LEFT,RIGHT a line (1 or 0, -1) played at --clock between two --levels, or
                     rows under time,left,right or time,left,right,lift, each held until the next (a
                     craft that lists its thrusters has its channels there, and no bits); a bit
                     that was recorded as several equal lines is one bit (--rows-per-bit)

With --room a design is played in bursts, and between them ModelPredictive drives the craft home, so
that it stays inside; a tracking controller stops before it would leave.

Half a second of rest, then lift alone for --lift-time, then --duration of input, then half a second
with everything off. A file with a column lift is played as it is. The same command line gives the
same bag, bit by bit, except for the computing times of a controller (topic decision). The topics are
those of record.launch; simulator/truth has the true motion.

A disturbance in the model file acts only with --disturbance; without it, a line says so.
"""
)

OPTIONS = (
    simulating.PATTERN + simulating.BURSTS + simulating.TRACKING + simulating.LIFT
)  # options for some inputs only


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    _add_run_arguments(parser)
    _add_input_arguments(parser.add_argument_group("input"))
    conditions.add_disturbance_arguments(parser.add_argument_group("disturbance"))
    _add_mocap_arguments(parser.add_argument_group("motion capture"))
    _add_tracking_arguments(parser.add_argument_group("tracking"))


def _add_run_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", metavar="M.yaml", required=True, help="true model of the craft")
    parser.add_argument(
        "--input",
        type=_kind,
        required=True,
        metavar="KIND",
        help=", ".join(KINDS) + " or FILE.csv (below)",
    )
    parser.add_argument("-o", "--output", metavar="RUN.bag", required=True)
    parser.add_argument("--force", action="store_true", help="overwrite the bag")
    parser.add_argument(
        "--seed",
        type=common.seed,
        default=1,
        help="for the mocap's noise and losses, the disturbance, and the start of the PRBS "
        "(%(default)s)",
    )
    parser.add_argument(
        "--duration",
        type=conditions.between("duration"),
        metavar="S",
        help="duration of the input [s] (%g, or that of the rows in FILE.csv)" % DURATION,
    )
    parser.add_argument(
        "--lift", type=conditions.between("lift"), help="input of the lift fan, 0..1 (1)", metavar="LIFT"
    )
    parser.add_argument(
        "--lift-time",
        type=conditions.between("lift_time"),
        metavar="S",
        help="lift alone before thrust [s] (1)",
    )
    parser.add_argument(
        "--start-pose",
        type=common.number,
        nargs=3,
        metavar=("X", "Y", "PSI"),
        default=[0.0, 0.0, 0.0],
        help="pose at the start, world_ned [m, m, rad] (0 0 0)",
    )
    parser.add_argument(
        "--start-velocity",
        type=common.number,
        nargs=3,
        metavar=("U", "V", "R"),
        default=[0.0, 0.0, 0.0],
        help="velocity at the start, body [m/s, m/s, rad/s] (0 0 0)",
    )


def _add_input_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--clock", type=conditions.between("clock"), metavar="HZ", help="bits per second (15)")
    group.add_argument(
        "--order",
        type=int,
        choices=range(2, 21),
        metavar="2..20",
        help="order N of a sequence of 2^N - 1 bits (9)",
    )
    group.add_argument(
        "--rows-per-bit",
        type=common.count,
        metavar="N",
        help="FILE.csv of bits: lines per bit (found from the file)",
    )
    group.add_argument(
        "--levels",
        type=conditions.between("levels"),
        nargs="+",
        metavar="LEVEL",
        help="inputs, 0..1, or -1..1 if a thruster can be reversed: low and high; any number for "
        "steps, single-thruster and multilevel-prbs (0 1; these 0 0.25 0.5 0.75 1)",
    )
    group.add_argument(
        "--hold",
        type=conditions.between("hold"),
        metavar="S",
        help="time for which a level is held [s] (1)",
    )
    group.add_argument(
        "--room",
        metavar="ROOM.yaml",
        help="play bursts of the input between returns home, inside this room",
    )
    group.add_argument(
        "--burst",
        type=conditions.between("burst"),
        metavar="S",
        help="with --room, longest burst [s] (%g)" % _core.ReturnParams().burst,
    )


def _add_mocap_arguments(group: argparse._ArgumentGroup) -> None:
    conditions.add_mocap_arguments(group)
    group.add_argument(
        "--axes", default=AXES, help="world_ned x, y, z in the mocap's axes (%(default)s)"
    )
    group.add_argument(
        "--heading-offset",
        type=common.number,
        default=0.0,
        metavar="RAD",
        help="heading of the rigid body minus the craft's; recorded with the run, like the axes (0)",
    )


def _add_tracking_arguments(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--controller", choices=loop.CONTROLLERS, help="(TrajectoryTracking)")
    kinds = [name for name in loop.KINDS if name != "file"]
    group.add_argument("--reference", choices=kinds, help="(circle)")
    group.add_argument(
        "--origin", type=common.number, nargs=2, metavar=("X", "Y"), help="centre or start [m] (0 0)"
    )
    group.add_argument(
        "--end", type=common.number, nargs=2, metavar=("X", "Y"), help="end of a line [m] (2.5 2.5)"
    )
    group.add_argument("--sharp", action="store_true", help="line: start and stop suddenly")
    for parameter in REFERENCE + GAINS:
        option = "--" + parameter.name.replace("_", "-")
        described = listing.option(parameter, parameter.default)
        group.add_argument(option, type=common.number, **described)
    conditions.add_number(group, "control_rate", "HZ", "control rate", _core.TrackingParams().life.rate)
    group.add_argument(
        "--max-error",
        type=common.number,
        metavar="M",
        help="error at which the controller stops when it lasts for 1 s, 0: a quarter of the "
        "reference's half-width [m] (never)",
    )
    group.add_argument(
        "--controller-model", metavar="C.yaml", help="the controller's model (--model)"
    )


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    model = Model.load(arguments.model)
    arguments.work.expect(SIMULATING, 1, 0.2)
    bag_writer.expect(arguments.work, arguments.duration or DURATION)
    with arguments.work.stage(SIMULATING):
        run = simulating.simulate(
            model,
            arguments.input,
            duration=arguments.duration,
            seed=arguments.seed,
            name=os.path.splitext(os.path.basename(arguments.output))[0],
            start_pose=arguments.start_pose,
            start_velocity=arguments.start_velocity,
            mocap=conditions.given(arguments, simulating.MOCAP),
            disturbance=conditions.disturbance(arguments.disturbance),
            trim=arguments.trim,
            axes=arguments.axes,
            heading_offset=arguments.heading_offset,
            **conditions.given(arguments, OPTIONS),
        )
    counts = run.save(arguments.output, arguments.force, arguments.work)
    for line in _lines(arguments, model, run):
        common.say(arguments, line)
    if run.stopped:
        print("identify simulate: the controller stopped: %s" % run.stopped, file=sys.stderr)
    return {
        "bag": arguments.output,
        "input": arguments.input,
        "sequence": run.sequence or None,
        "seed": arguments.seed,
        "disturbance": _described(run.disturbance),
        "duration": run.length,
        "messages": counts,
        "frames_not_delivered": run.frames_not_delivered,
        "bursts": run.bursts,
        "stopped": run.stopped or None,
        "tracking_error": run.tracking_error,
    }


def _lines(arguments: argparse.Namespace, model: Model, run: SimulatedRun) -> Iterator[str]:
    yield "%s: %.2f s, %d poses (%d frames not delivered), %d commands" % (
        arguments.output,
        run.length,
        len(run.pose_times),
        run.frames_not_delivered,
        len(run.control_times),
    )
    if run.sequence:
        yield "%s: %s" % (arguments.input, run.sequence)
    if run.marks:
        yield _bursts(run)
    if run.disturbance is None and not model.core.disturbance.empty():
        yield "%s has a disturbance, which did not act: --disturbance applies it" % arguments.model
    if run.tracking_error is not None:
        yield "tracking error: %.3f m rms" % run.tracking_error


def _described(disturbance: Optional[_core.Disturbance]) -> Optional[Document]:
    """A disturbance for --json, SI units."""
    if disturbance is None:
        return None
    found = {name: list(getattr(disturbance, name)) for name in ("sigma", "time", "white", "trim")}
    return dict(found, trim_thrust=disturbance.trim_thrust)


def _bursts(run: SimulatedRun) -> str:
    """One line on the bursts of an excitation."""
    times = [mark[0] for mark in run.marks] + [run.control_times[run.controls[:, -1] > 0][-1]]
    driven = sum(b - a for a, b, mark in zip(times, times[1:], run.marks) if mark[2])
    return "%d bursts, %.1f s of %.1f s; between them the craft returned home" % (
        sum(mark[2] for mark in run.marks),
        driven,
        times[-1] - times[0],
    )


def _kind(text: str) -> str:
    if text not in KINDS and not text.lower().endswith(".csv"):
        raise argparse.ArgumentTypeError(
            "'%s' is neither one of %s nor a .csv file" % (text, ", ".join(KINDS))
        )
    return text
