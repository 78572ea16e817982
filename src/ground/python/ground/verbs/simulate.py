"""identify simulate: a recording of a simulated experiment."""
import argparse
import os
import sys

import numpy as np

from ground import _core, files
from ground.errors import GroundError
from ground.recordings import bags, run_parameters
from ground.recordings.settings import AXES
from ground.simulation import experiments, gains, tracking as loop
from ground.verbs import common, listing

NAME = "simulate"
SUMMARY = "records a simulated experiment to a bag, without ROS running and faster than real time"
DESIGNS = {info.name: info for info in _core.design_table()}
KINDS = [name for name in DESIGNS if name != "file"] + ["tracking"]
DURATION = 20.0  # [s]
WITH_RETURNS = 4  # times the length of timed rows: what bursts and returns may take together

DETAILS = (
    "\ninputs:\n"
    + "".join("  %-18s %s\n" % (name, info.text) for name, info in DESIGNS.items() if name in KINDS)
    + """  tracking           a controller follows a reference, on what the mocap delivers
  FILE.csv           bits LEFT,RIGHT a line (1 or 0, -1) played at --clock between two --levels, or
                     rows under time,left,right or time,left,right,lift, each held until the next;
                     a bit that was recorded as several equal lines is one bit (--rows-per-bit)

With --room a design is played in bursts, and between them ModelPredictive drives the craft home, so
that it stays inside; a tracking controller stops before it would leave.

Half a second of rest, then lift alone for --lift-time, then --duration of input, then half a second
with everything off. A file with a column lift is played as it is. The same command line gives the
same bag, bit by bit, but for the computing times of a controller (topic decision). The topics are those of record.launch; simulator/truth has the true motion.

A disturbance in the model file acts only with --disturbance; without it, a line says so.
"""
)

# option, its place in _core's parameters, metavar, help
MOCAP = [
    ("--rate", "rate", "HZ", "frames per second"),
    ("--position-noise", "position_noise", "M", "noise of x and y, 1 sigma"),
    ("--heading-noise", "heading_noise", "RAD", "noise of the heading, 1 sigma"),
    ("--latency", "latency", "S", "from capture to delivery"),
    ("--loss", "loss", "SHARE", "share of single frames lost, 0..1"),
    ("--gap-rate", "gap_rate", "1/S", "losses of tracking per second"),
    ("--gap-length", "gap_length", "S", "mean duration of a loss of tracking"),
]
# parameters of references and controllers that are options here
REFERENCE = [
    p for p in _core.reference_parameters() if p.name in ("size", "rate_of_turn", "petals", "speed")
]
GAINS = gains.CONTROLLERS["TrajectoryTracking"].parameters


def _dest(option):
    return option.strip("-").replace("-", "_")


CONTROL = [("--control-rate", "rate", "HZ", "control rate")]
LIFT = ["lift", "lift_time"]
PATTERN = ["clock", "order", "levels", "hold", "rows_per_bit"]
BURSTS = ["room", "burst"]
TRACKING = ["controller", "reference", "origin", "end", "sharp", "controller_model", "max_error"] + [
    _dest(option) for option, _, _, _ in CONTROL
]
TRACKING += [parameter.name for parameter in REFERENCE + GAINS]


def _takes(kind):
    """Which of these options an input takes; timed and lifted: a CSV file with a column time, and one
    with a column lift as well."""
    if kind == "tracking":
        return TRACKING + LIFT + ["room"]
    if kind in ("timed", "lifted"):
        return BURSTS + (LIFT if kind == "timed" else [])
    return [name for name in DESIGNS[kind].takes if name in PATTERN] + LIFT + BURSTS


def configure(parser):
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    parser.add_argument("--model", metavar="M.yaml", required=True, help="moves the craft")
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
        help="of the mocap's noise and losses, of the disturbance, and of where the PRBS starts "
        "(%(default)s)",
    )
    parser.add_argument(
        "--duration",
        type=_between(0.1, experiments.LONGEST),
        metavar="S",
        help="of the input [s] (%g, or that of the rows in FILE.csv)" % DURATION,
    )
    parser.add_argument(
        "--lift", type=_between(0, 1), help="input of the lift fan, 0..1 (1)", metavar="LIFT"
    )
    parser.add_argument(
        "--lift-time", type=_between(0, 30), metavar="S", help="lift alone before thrust [s] (1)"
    )
    parser.add_argument(
        "--start-pose",
        type=_number,
        nargs=3,
        metavar=("X", "Y", "PSI"),
        default=[0.0, 0.0, 0.0],
        help="world_ned [m, m, rad] (0 0 0)",
    )
    parser.add_argument(
        "--start-velocity",
        type=_number,
        nargs=3,
        metavar=("U", "V", "R"),
        default=[0.0, 0.0, 0.0],
        help="body, as the recording starts [m/s, m/s, rad/s] (0 0 0)",
    )
    pattern = parser.add_argument_group("input")
    pattern.add_argument(
        "--clock", type=_between(0.1, 500), metavar="HZ", help="bits per second (15)"
    )
    pattern.add_argument(
        "--order", type=int, choices=range(2, 21), metavar="2..20", help="of a sequence of 2^N - 1 bits (9)"
    )
    pattern.add_argument(
        "--rows-per-bit",
        type=common.count,
        metavar="N",
        help="bits: lines that make one bit (found in the file)",
    )
    pattern.add_argument(
        "--levels",
        type=_between(0, 1),
        nargs="+",
        metavar="LEVEL",
        help="inputs, 0..1: low and high; any number for steps, single-thruster and "
        "multilevel-prbs (0 1; these 0 0.25 0.5 0.75 1)",
    )
    pattern.add_argument(
        "--hold",
        type=_between(0.02, 100),
        metavar="S",
        help="how long a level is held [s] (1)",
    )
    pattern.add_argument(
        "--room", metavar="ROOM.yaml", help="bursts of the input between returns home, inside a room"
    )
    pattern.add_argument(
        "--burst",
        type=_between(0.1, experiments.LONGEST),
        metavar="S",
        help="with --room, longest burst [s] (%g)" % _core.ReturnParams().burst,
    )
    disturbance = parser.add_argument_group("disturbance")
    disturbance.add_argument(
        "--disturbance",
        type=_number,
        nargs="*",
        metavar=("SHARE", "TIME"),
        help="a random wrench pushes the craft: its standard deviation as a share of full thrust (X, "
        "Y) and of the moment of one thruster (N), its correlation time [s]; without numbers the "
        "disturbance of the model file",
    )
    disturbance.add_argument(
        "--trim",
        type=_between(0, 0.3),
        metavar="SHARE",
        help="what differs from run to run, 1 sigma: a constant wrench, in the same shares, and the "
        "factor on the thrust",
    )
    mocap = parser.add_argument_group("motion capture")
    _add_numbers(mocap, MOCAP, _core.MocapParams())
    mocap.add_argument(
        "--axes", default=AXES, help="world_ned x, y, z in the mocap's axes (%(default)s)"
    )
    mocap.add_argument(
        "--heading-offset",
        type=_number,
        default=0.0,
        metavar="RAD",
        help="of the rigid body against the craft; recorded with the run, like the axes (0)",
    )
    defaults = _core.TrackingParams()
    tracking = parser.add_argument_group("tracking")
    tracking.add_argument("--controller", choices=loop.CONTROLLERS, help="(TrajectoryTracking)")
    kinds = [name for name in loop.KINDS if name != "file"]
    tracking.add_argument("--reference", choices=kinds, help="(circle)")
    tracking.add_argument(
        "--origin", type=_number, nargs=2, metavar=("X", "Y"), help="centre or start [m] (0 0)"
    )
    tracking.add_argument(
        "--end", type=_number, nargs=2, metavar=("X", "Y"), help="of a line [m] (2.5 2.5)"
    )
    tracking.add_argument("--sharp", action="store_true", help="line: start and stop suddenly")
    for parameter in REFERENCE + GAINS:
        option = "--" + parameter.name.replace("_", "-")
        described = listing.option(parameter, parameter.default)
        tracking.add_argument(option, type=_number, **described)
    _add_numbers(tracking, CONTROL, defaults.life)
    tracking.add_argument(
        "--max-error",
        type=_number,
        metavar="M",
        help="error at which the controller stops when it lasts for 1 s, 0: a quarter of the "
        "reference's half-width [m] (never)",
    )
    tracking.add_argument(
        "--controller-model", metavar="C.yaml", help="what the controller believes (--model)"
    )


def run(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = common.load(arguments.model)
    believed = common.load(arguments.controller_model) if arguments.controller_model else None
    name = os.path.splitext(os.path.basename(arguments.output))[0]
    drive, sequence = _drive(arguments)
    mocap = _filled(_core.MocapParams(), MOCAP, arguments)
    start = arguments.start_pose, arguments.start_velocity
    disturbance = _disturbance(arguments, model)
    try:
        _core.AxisMapping(arguments.axes, arguments.heading_offset)
        run = experiments.simulate(
            model, drive, name, *start, mocap, arguments.seed, believed, disturbance
        )
    except ValueError as error:
        arguments.refuse(str(error))
    run.made_with = run_parameters.document(_parameters(arguments, drive))
    counts = bags.write(
        run, arguments.output, arguments.axes, arguments.heading_offset, arguments.force
    )
    result = {
        "bag": arguments.output,
        "input": arguments.input,
        "sequence": sequence or None,
        "seed": arguments.seed,
        "disturbance": _described(disturbance),
        "duration": float(run.truth_times[-1] - run.truth_times[0]),
        "messages": counts,
        "frames_not_delivered": len(run.truth_times) - len(run.pose_times),
        "bursts": sum(burst for _, _, burst, _ in run.marks),
        "stopped": run.stopped or None,
        "tracking_error": _tracking_error(run),
    }
    common.say(
        arguments,
        "%s: %.2f s, %d poses (%d frames not delivered), %d commands"
        % (
            arguments.output,
            result["duration"],
            len(run.pose_times),
            result["frames_not_delivered"],
            len(run.control_times),
        ),
    )
    if sequence:
        common.say(arguments, "%s: %s" % (arguments.input, sequence))
    if run.marks:
        common.say(arguments, _bursts(run))
    if disturbance is None and not model.disturbance.empty():
        common.say(
            arguments,
            "%s has a disturbance, which did not act: --disturbance applies it" % arguments.model,
        )
    if result["tracking_error"] is not None:
        common.say(arguments, "tracking error: %.3f m rms" % result["tracking_error"])
    if run.stopped:
        print("identify simulate: the controller stopped: %s" % run.stopped, file=sys.stderr)
    return result


def _parameters(arguments, drive):
    """What the run was made with, by the nodes that would have made it."""
    controller = {"design": arguments.input if arguments.input in KINDS else "file"}
    if isinstance(drive, _core.ExcitationParams):
        controller.update(kind="Excitation")
    elif isinstance(drive, _core.TrackingParams):
        controller = {"kind": drive.controller.kind, "reference": drive.reference.kind}
    if arguments.input not in KINDS:
        controller["file"] = arguments.input
    if isinstance(drive, _core.DriveParams):
        controller["model"] = arguments.controller_model or arguments.model
    if arguments.room:
        controller["room"] = arguments.room
    return {"controller": controller, "simulator": {"model": arguments.model}}


def _drive(arguments):
    """What drives the craft, and one line on how a file of bits is played (else empty); ends with bad
    usage when an option does not go with the input."""
    kind = arguments.input
    room = common.load_room(arguments.room) if arguments.room else None
    if kind == "tracking":
        _refuse_unused(arguments, kind)
        return _tracking(arguments, room), ""
    options = {"seed": arguments.seed}
    if kind not in KINDS:
        kind, options = "file", {"file": arguments.input}
    options.update(_given(arguments, PATTERN))
    try:
        signal = experiments.design(kind, arguments.duration or DURATION, **options)
    except ValueError as error:
        arguments.refuse(str(error))
    timed = kind == "file" and not signal.description  # rows under a header, not bits
    _refuse_unused(arguments, "lifted" if signal.has_lift else "timed" if timed else kind)
    duration = arguments.duration or signal.end * (WITH_RETURNS if timed and room else 1)
    if room is None:
        if arguments.burst is not None:
            arguments.refuse("--burst needs --room")
        if signal.has_lift:
            return experiments.as_given(signal.rows, duration), ""
        lift = _given(arguments, LIFT)
        return experiments.with_lift(signal.rows[:, :3], duration, **lift), signal.description
    params = _core.ExcitationParams()
    params.design = experiments.design_params(kind, **options)
    if arguments.burst is not None:
        params.returns.burst = arguments.burst
    return _with_life(params, arguments, duration, room), signal.description


def _with_life(params, arguments, duration, room):
    """The DriveParams with what all controllers take."""
    params.start, params.tail = experiments.LEAD, experiments.TAIL
    params.duration, params.room = duration, room
    for name, value in _given(arguments, LIFT).items():
        setattr(params.life, name, value)
    _filled(params.life, CONTROL, arguments)
    return params


def _disturbance(arguments, model):
    """The _core.Disturbance by --disturbance and --trim; None without either."""
    given, trim = arguments.disturbance, arguments.trim
    if given is None and trim is None:
        return None
    if given == []:
        found = model.copy().disturbance
        if found.empty():
            arguments.refuse("--disturbance: %s has none; give SHARE and TIME" % arguments.model)
        if trim is None:
            return found
    elif given is None:
        found = _core.Disturbance()
    elif len(given) == 2 and 0 <= given[0] <= 1 and given[1] > 0:
        found = experiments.disturbance_in_shares(model, *given)
    else:
        arguments.refuse(
            "--disturbance takes a SHARE between 0 and 1 and a positive TIME, or nothing, not %s"
            % " ".join("%g" % value for value in given)
        )
    own = experiments.disturbance_in_shares(model, trim=trim or 0.0)
    found.trim, found.trim_thrust = own.trim, own.trim_thrust
    return found


def _described(disturbance):
    """What --json says of a disturbance, SI units."""
    if disturbance is None:
        return None
    found = {name: list(getattr(disturbance, name)) for name in ("sigma", "time", "white", "trim")}
    return dict(found, trim_thrust=disturbance.trim_thrust)


def _tracking(arguments, room):
    params = _core.TrackingParams()
    _with_life(params, arguments, arguments.duration or DURATION, room)
    params.max_error = np.inf if arguments.max_error is None else arguments.max_error
    params.controller.kind = arguments.controller or params.controller.kind
    values = _given(arguments, [parameter.name for parameter in GAINS])
    settings = _given(arguments, [parameter.name for parameter in REFERENCE])
    for option, names in {"origin": ("x", "y"), "end": ("end_x", "end_y")}.items():
        settings.update(zip(names, getattr(arguments, option) or ()))
    if arguments.sharp:
        settings["smooth"] = False
    try:
        gains.put(params.controller, values)
        reference = loop.reference(arguments.reference or "circle", **settings)
    except GroundError as error:
        arguments.refuse(str(error))
    params.reference = reference
    if room is not None:
        leaves = _core.leaves_room(reference, room)
        if leaves:
            arguments.refuse("the reference does not fit into %s: %s" % (arguments.room, leaves))
    return params


def _bursts(run):
    """One line on the bursts of an excitation."""
    times = [mark[0] for mark in run.marks] + [run.control_times[run.controls[:, 2] > 0][-1]]
    driven = sum(b - a for a, b, mark in zip(times, times[1:], run.marks) if mark[2])
    return "%d bursts, %.1f s of %.1f s; between them the craft returned home" % (
        sum(mark[2] for mark in run.marks),
        driven,
        times[-1] - times[0],
    )


def _tracking_error(run):
    """Root mean square of the true distance from the reference [m]; None without one."""
    if not len(run.references):
        return None
    at = np.searchsorted(run.truth_times, run.references[:, 0])
    off = run.truth_eta[at, :2] - run.references[:, 1:3]
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _add_numbers(group, options, defaults):
    for option, name, metavar, text in options:
        text = "%s (%g)" % (text, getattr(defaults, name))
        group.add_argument(option, type=_number, metavar=metavar, help=text)


def _filled(params, options, arguments):
    for option, name, _, _ in options:
        value = getattr(arguments, _dest(option))
        if value is not None:
            setattr(params, name, value)
    return params


def _given(arguments, names):
    values = {name: getattr(arguments, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def _refuse_unused(arguments, kind):
    for name in PATTERN + BURSTS + TRACKING + LIFT:
        value = getattr(arguments, name)
        if name not in _takes(kind) and value is not None and value is not False:
            arguments.refuse(
                "--%s does not go with --input %s" % (name.replace("_", "-"), arguments.input)
            )


def _kind(text):
    if text not in KINDS and not text.lower().endswith(".csv"):
        raise argparse.ArgumentTypeError(
            "'%s' is neither one of %s nor a .csv file" % (text, ", ".join(KINDS))
        )
    return text


def _number(text):
    value = float(text)
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not finite" % text)
    return value


def _between(low, high):
    def parse(text):
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError("%s is not between %g and %g" % (text, low, high))
        return value

    parse.__name__ = "number"
    return parse
