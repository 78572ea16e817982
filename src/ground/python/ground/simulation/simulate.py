"""simulate: a recording of a simulated experiment.

It is longer than 400 lines, because a third of it are options and their help.
"""

import argparse
import functools
import os
import sys
from dataclasses import dataclass, fields, make_dataclass, replace
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple, TypeVar, Union

import numpy as np

from ground import _core
from ground.effect_library.parameters import described
from ground.models import Model, ModelLike, Room, RoomLike
from ground.reading import messages, run_settings
from ground.reading.run_settings import AXES
from ground.simulation import array_inputs, experiments, gains, listing
from ground.simulation import tracking as loop
from ground.simulation.simulated_run import SimulatedRun
from ground.support import command_line, files
from ground.support.annotations import Array, Document, Path
from ground.support.command_line import count, number, option, seed
from ground.support.errors import GroundError, OptionError, warn
from ground.support.headline import Line, formatted
from ground.support.progress import say

DESIGNS = {info.name: info for info in _core.design_table()}
KINDS = [name for name in DESIGNS if name != "file"] + ["tracking"]
DURATION = 20.0  # [s]
ARRAY = "array"  # rows of inputs that a caller gives

# Options that belong to some inputs only, by the part that they belong to
LIFT = ("lift", "lift_time")
PATTERN = ("clock", "order", "levels", "hold", "rows_per_bit")
BURSTS = ("room", "burst")

_P = TypeVar("_P", bound=_core.DriveParams)
Disturbance = Union[bool, Sequence[float]]


_input = functools.partial(option, None, group="input")
_tracking = functools.partial(option, None, group="tracking")


def _mocap(name: str, metavar: str, text: str) -> Any:
    """An option that replaces a value of the motion capture."""
    text = "%s (%g)" % (text, getattr(_core.MocapParams(), name))
    return option(None, text, type=number, metavar=metavar, group="motion capture")


@dataclass(frozen=True)
class Mocap:
    """The motion capture; None means the default."""

    rate: Optional[float] = _mocap("rate", "HZ", "frames per second")
    position_noise: Optional[float] = _mocap("position_noise", "M", "noise of x and y, 1 sigma [m]")
    heading_noise: Optional[float] = _mocap("heading_noise", "RAD", "noise of the heading, 1 sigma [rad]")
    latency: Optional[float] = _mocap("latency", "S", "time from capture to delivery [s]")
    loss: Optional[float] = _mocap("loss", "SHARE", "share of single frames lost, 0..1")
    gap_rate: Optional[float] = _mocap("gap_rate", "1/S", "losses of tracking per second")
    gap_length: Optional[float] = _mocap("gap_length", "S", "mean duration of a loss of tracking [s]")

    def params(self) -> _core.MocapParams:
        """The _core.MocapParams with these values."""
        params = _core.MocapParams()
        for name, value in command_line.given(self, [f.name for f in fields(Mocap)]).items():
            setattr(params, name, value)
        return params


@dataclass(frozen=True)
class Acting:
    """What acts on the craft besides the model."""

    disturbance: Disturbance = option(
        False,
        "apply a random disturbance: its standard deviation as a share of full thrust (X, Y) and of the "
        "moment of one thruster (N), and its correlation time [s]; without numbers (True), as in the model "
        "file",
        type=number,
        nargs="*",
        metavar="SHARE TIME",
        group="disturbance",
    )
    trim: Optional[float] = option(
        None,
        "differences from run to run, 1 sigma: a constant wrench, in the same shares, and a factor on the "
        "thrust",
        range=(0.0, 0.3),
        metavar="SHARE",
        group="disturbance",
    )


@dataclass(frozen=True)
class _Options(Acting, Mocap):
    """An experiment."""

    seed: int = option(
        1,
        "seed of the mocap's noise and losses, the disturbance, and the start of the PRBS (%(default)s)",
        type=seed,
    )
    duration: Optional[float] = option(
        None,
        "duration of the input [s] (%g, or the duration of the rows in FILE.csv)" % DURATION,
        range=(0.1, experiments.MAX_DURATION),
        metavar="S",
    )
    lift: Optional[float] = option(None, "input of the lift fan, 0..1 (1)", range=(0.0, 1.0), metavar="LIFT")
    lift_time: Optional[float] = option(
        None, "lift only, before thrust [s] (1)", range=(0.0, 30.0), metavar="S"
    )
    start_pose: Sequence[float] = option(
        (0.0, 0.0, 0.0),
        "pose at the start, world_ned [m, m, rad] (0 0 0)",
        type=number,
        nargs=3,
        metavar=("X", "Y", "PSI"),
    )
    start_velocity: Sequence[float] = option(
        (0.0, 0.0, 0.0),
        "velocity at the start, body [m/s, m/s, rad/s] (0 0 0)",
        type=number,
        nargs=3,
        metavar=("U", "V", "R"),
    )
    clock: Optional[float] = _input("bits per second (15)", range=(0.001, 500.0), metavar="HZ")
    order: Optional[int] = _input(
        "order N of a sequence of 2^N - 1 bits (9)", type=int, range=(2, 20), metavar="2..20"
    )
    rows_per_bit: Optional[int] = _input(
        "FILE.csv of a bit sequence: number of equal lines per bit (found from the file)",
        type=count,
        metavar="N",
    )
    levels: Optional[Sequence[float]] = _input(
        "inputs, 0..1, or -1..1 if a thruster can be reversed: low and high; any number for steps, "
        "single-thruster and multilevel-prbs (0 1; these 0 0.25 0.5 0.75 1)",
        range=(-1.0, 1.0),
        nargs="+",
        metavar="LEVEL",
    )
    hold: Optional[float] = _input(
        "time for which a level is held [s] (1)", range=(0.02, 3600.0), metavar="S"
    )
    room: Optional[RoomLike] = _input(
        "play bursts of the input between returns home, inside this room", metavar="ROOM.yaml"
    )
    burst: Optional[float] = _input(
        "with --room, longest burst [s] (%g)" % _core.ReturnParams().burst,
        range=(0.1, experiments.MAX_DURATION),
        metavar="S",
    )
    axes: str = option(AXES, "world_ned x, y, z in the mocap's axes (%(default)s)", group="motion capture")
    heading_offset: float = option(
        0.0,
        "heading of the rigid body minus the craft's [rad]; recorded with the run, like the axes (0)",
        type=number,
        metavar="RAD",
        group="motion capture",
    )
    imu: bool = option(
        False,
        "also record the craft's gyro and accelerometer, with typical noise, biases, mounting and delay",
    )
    battery: Optional[float] = option(
        None,
        "the craft has a battery that drives all motors at full input for this long [s], and records its "
        "voltage; the body in the model file needs the key volts",
        range=(1.0, 1e6),
        metavar="S",
    )
    charge: Optional[float] = option(
        None, "charge of the battery at the start, 0..1 (1)", range=(0.01, 1.0), metavar="CHARGE"
    )
    controller: Optional[str] = _tracking("control law (TrajectoryTracking)", choices=list(gains.CONTROLLERS))
    reference: Optional[str] = _tracking(
        "reference to follow (circle)", choices=[kind for kind in loop.KINDS if kind != "file"]
    )


#: An experiment: _Options, and parameters of references.
SimulateOptions = make_dataclass(
    "SimulateOptions",
    list(listing.reference_fields()),
    bases=(_Options,),
    namespace={"__module__": __name__},
    frozen=True,
)
TRACKING = tuple(f.name for f in fields(SimulateOptions) if f.metadata.get("group") == "tracking")


@command_line.takes(SimulateOptions)
def simulate(
    model: ModelLike,
    input: Path = "prbs",
    *,
    inputs: Optional[array_inputs.Inputs] = None,
    name: str = "simulated",
    options: _Options,
) -> SimulatedRun:
    """Simulates an experiment, without ROS and faster than real time.

    Parameters
    ----------
    model : Model or path
        The true model of the craft.
    input : str or path, default 'prbs'
        A design such as "prbs", "multilevel-prbs" or "spin" (`identify simulate --help` lists them),
        "tracking" for a controller in the loop, or a CSV file of bits or timed rows.
    inputs : array (n, 1 + channels) or DataFrame, optional
        Inputs instead of `input`: rows of time [s] and one command per channel of the model, each held until
        the next row; the last row ends the run. A DataFrame needs columns t and the channels by name. Without
        the column of the lift, `lift` and `lift_time` set it.
    name : str, default 'simulated'
        Name of the run.

    Returns
    -------
    SimulatedRun
        The recording, and the true motion.

    Raises
    ------
    OptionError
        When an option does not fit the input.
    GroundError
        When there is nothing to record.

    Examples
    --------
    >>> run = ground.simulate(model_file, "prbs", duration=5, seed=3)
    >>> run
    <SimulatedRun simulated: 6.99 s, 700 poses, 401 commands>
    >>> run.truth_wrench.any()  # no disturbance acted
    False
    >>> turning = ground.simulate(model_file, inputs=[[0, 1, 0], [2, 0, 0]])  # left alone for 2 s
    >>> turning.to_frame().psi.max() > 1  # [rad]
    True
    >>> ground.simulate(model_file, "prbs", burst=2)
    Traceback (most recent call last):
    ...
    ground.support.errors.OptionError: burst needs room
    """
    mover = Model.of(model)
    _warn_of_neutral(mover)
    rows = None if inputs is None else array_inputs.rows_of(inputs, mover.core)
    drive = _Drive(files.path_of(input, "a name of an input"), options, mover.core, rows)
    acting = disturbance_on(mover, options.disturbance, options.trim)
    try:
        _core.AxisMapping(options.axes, options.heading_offset)
        run = experiments.simulate(
            mover.core,
            drive.params,
            name,
            options.start_pose,
            options.start_velocity,
            options.params(),
            options.seed,
            disturbance=acting,
            battery=_battery(options),
        )
    except ValueError as error:
        raise _refused(error) from None
    if options.imu:
        run = run.sensed(options.seed)
    return replace(
        run,
        axes=options.axes,
        heading_offset=options.heading_offset,
        sequence=drive.sequence,
        disturbance=acting,
        made_with=run_settings.document(drive.parameters(mover)),
        files={"truth": run_settings.RunFile(mover.path or "truth.yaml", mover.format())},
    )


def _refused(error: Exception) -> OptionError:
    """What is wrong with an option; where the text begins with the option's name, it can be told as on the
    command line."""
    name, _, why = str(error).partition(" ")
    is_option = name in (one.name for one in fields(SimulateOptions))
    return OptionError("{0} {why}", name, why=why) if is_option else OptionError("{why}", why=error)


def _warn_of_neutral(model: Model) -> None:
    """Warns of effects of a model that do nothing."""
    for effect in model.effects:
        known = described(model.core).items()
        own = [(n, p) for n, p in known if n.startswith(effect + ".") and not p.shape]
        if own and all(model[name] == p.neutral for name, p in own):
            name, p = own[0]
            text = "%s does nothing at these values; give it others, such as %s = %.2g %s"
            warn(text % (effect, name, p.scale, p.unit))


def _battery(options: _Options) -> Tuple[float, float]:
    """How long the battery lasts [s], 0 without one, and its charge."""
    if options.battery is None and options.charge is not None:
        raise OptionError("{0} needs {1}", "charge", "battery")
    return options.battery or 0.0, 1.0 if options.charge is None else options.charge


class _Drive:
    """What drives the craft.

    Attributes: params, a Schedule or _core.DriveParams; sequence, one line on how a file of bits is
    played (else empty). OptionError when an option does not go with the input.
    """

    def __init__(
        self, kind: str, options: _Options, craft: _core.Model, rows: Optional[Array] = None
    ) -> None:
        if rows is not None:
            kind = ARRAY
        elif kind not in KINDS and not kind.lower().endswith(".csv"):
            known = ", ".join(KINDS)
            raise OptionError("'{kind}' is neither one of {known} nor a .csv file", kind=kind, known=known)
        self.kind, self._craft, self._all = kind, craft, options
        self.options = command_line.given(options, (*PATTERN, *BURSTS, *TRACKING, *LIFT))
        room = self.options.get("room")
        self.room = None if room is None else Room.of(room)
        self.sequence = ""
        self.params: experiments.Drive
        if rows is not None:
            self.params = self._given_rows(rows, options.duration or rows[-1, 0])
        elif kind == "tracking":
            self._refuse_unused(kind)
            self.params = self._tracking(options.duration or DURATION)
        else:
            self._play(options.seed, options.duration)

    def _given_rows(self, rows: Array, duration: float) -> experiments.Schedule:
        """Rows of time, commands."""
        has_lift = rows.shape[1] == 1 + len(self._craft.channels)
        self._refuse_unused(ARRAY if has_lift else "array without lift")
        if has_lift:
            return experiments.as_given(rows, duration)
        return experiments.with_lift(rows, duration, **self._given(LIFT))

    def _play(self, seed: int, duration: Optional[float]) -> None:
        """A design or a file, open loop or in bursts."""
        kind, options = self.kind, self._given(PATTERN)
        if kind in KINDS:
            options["seed"] = seed
        else:
            kind, options["file"] = "file", self.kind
        try:
            signal = experiments.design(kind, duration or DURATION, self._craft, **options)
        except ValueError as error:
            raise _refused(error) from None
        timed = kind == "file" and not signal.description  # rows under a header, not bits
        self._refuse_unused("lifted" if signal.has_lift else "timed" if timed else kind)
        length = duration or signal.end * (experiments.WITH_RETURNS if timed and self.room else 1)
        if self.room is not None:
            self.params = self._bursts(kind, options, length)
        elif "burst" in self.options:
            raise OptionError("{0} needs {1}", "burst", "room")
        elif signal.has_lift:
            self.params = experiments.as_given(signal.rows, length)
        else:
            self.params = experiments.with_lift(signal.rows[:, :-1], length, **self._given(LIFT))
        if not signal.has_lift or self.room is not None:
            self.sequence = signal.description

    def _bursts(self, kind: str, options: Document, duration: float) -> _core.ExcitationParams:
        params = _core.ExcitationParams()
        params.design = experiments.design_params(kind, self._craft, **options)
        if "burst" in self.options:
            params.returns.burst = self.options["burst"]
        return self._with_life(params, duration)

    def _with_life(self, params: _P, duration: float) -> _P:
        """The _core.DriveParams with the parameters of all controllers."""
        params.start, params.tail = experiments.LEAD, experiments.TAIL
        params.duration, params.room = duration, self.room.core if self.room else None
        for name, value in self._given(LIFT).items():
            setattr(params.life, name, value)
        return params

    def _tracking(self, duration: float) -> _core.TrackingParams:
        params = self._with_life(_core.TrackingParams(), duration)
        params.max_error = np.inf
        settings = listing.reference_settings(self._all)
        try:
            params.controller = gains.choice(self.options.get("controller", params.controller.kind))
            params.reference = loop.reference(self.options.get("reference", "circle"), **settings)
        except GroundError as error:
            raise _refused(error) from None
        if self.room is not None:
            leaves = _core.leaves_room(params.reference, self.room.core)
            if leaves:
                raise OptionError(
                    "the reference does not fit into {room}: {why}",
                    room=self.room.path or self.room.name,
                    why=leaves,
                )
        return params

    def _given(self, names: Sequence[str]) -> Document:
        return {name: self.options[name] for name in names if name in self.options}

    def _refuse_unused(self, kind: str) -> None:
        for name in self.options:
            if name not in _takes(kind):
                raise OptionError("{0} does not fit {1} {input}", name, "input", input=self.kind)

    def parameters(self, mover: Model) -> Dict[str, Dict[str, str]]:
        """Parameters of the run, by the ROS nodes that would have them."""
        controller = {"design": self.kind if self.kind in KINDS else "file"}
        if isinstance(self.params, _core.ExcitationParams):
            controller.update(kind="Excitation")
        elif isinstance(self.params, _core.TrackingParams):
            chosen = self.params
            controller = {"kind": chosen.controller.kind, "reference": chosen.reference.kind}
        if self.kind not in KINDS:
            controller["file"] = self.kind
        if isinstance(self.params, _core.DriveParams):
            controller["model"] = mover.path
        if self.room is not None:
            controller["room"] = self.room.path
        return {"controller": controller, "simulator": {"model": mover.path}}


def _takes(kind: str) -> List[str]:
    """Options that an input takes. Kinds "timed" and "lifted" are CSV files with a column time, and
    with a column lift as well."""
    if kind == "tracking":
        return [*TRACKING, *LIFT, "room"]
    if kind.startswith(ARRAY):
        return [] if kind == ARRAY else list(LIFT)
    if kind in ("timed", "lifted"):
        return [*BURSTS, *(LIFT if kind == "timed" else ())]
    return [*(name for name in DESIGNS[kind].takes if name in PATTERN), *LIFT, *BURSTS]


def disturbance_on(
    model: Model, given: Optional[Disturbance], trim: Optional[float]
) -> Optional[_core.Disturbance]:
    """The _core.Disturbance that acts; None where none does."""
    given = False if given is None else given
    if given is False and trim is None:
        return None
    if given is True or (given is not False and len(given) == 0):
        found = model.core.copy().disturbance
        if found.empty():
            raise OptionError(
                "{0}: {model} gives none; give SHARE and TIME", "disturbance", model=model.path or model.name
            )
        if trim is None:
            return found
    elif given is False:
        found = _core.Disturbance()
    elif len(given) == 2 and 0 <= given[0] <= 1 and given[1] > 0:
        found = experiments.disturbance_in_shares(model.core, *given)
    else:
        raise OptionError(
            "{0} accepts a SHARE between 0 and 1 and a positive TIME, or nothing, not {values}",
            "disturbance",
            values=" ".join("%g" % value for value in given),
        )
    own = experiments.disturbance_in_shares(model.core, trim=trim or 0.0)
    found.trim, found.trim_thrust = own.trim, own.trim_thrust
    return found


DETAILS = (
    "\ninputs:\n"
    + "".join("  %-18s %s\n" % (name, info.text) for name, info in DESIGNS.items() if name in KINDS)
    + """  tracking           a controller follows a reference, by the poses that the mocap delivers
  FILE.csv           lines LEFT,RIGHT of bits (1 or 0, -1) played at --clock between two --levels, or
                     rows under time,left,right or time,left,right,lift, each held until the next (a
                     craft that lists its thrusters has its channels there, and no bits); a bit
                     that was recorded as several equal lines is one bit (--rows-per-bit)

With --room a design is played in bursts, and between them ModelPredictive drives the craft home, so
that it stays inside; a tracking controller stops before it would leave.

Half a second of rest, then only lift for --lift-time, then --duration of input, then half a second
with everything off. A file with a column lift is played unchanged. The same command line gives the
same bag, bit for bit, except for the computing times of a controller (topic decision). The topics are
topics of record.launch; simulator/truth has the true motion.

A disturbance in the model file acts only with --disturbance; without it, a line reports this.
"""
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify simulate."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    command_line.add_model(parser, "true model of the craft")
    kinds = ", ".join(KINDS) + " or FILE.csv (below)"
    parser.add_argument("--input", required=True, metavar="KIND", help=kinds)
    command_line.add_output(parser, "RUN.bag")
    command_line.add_options(parser, SimulateOptions)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify simulate; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    messages.refuse_other_format(arguments.output)
    model = Model.load(arguments.model)
    with arguments.work.stage("simulating"):
        made = simulate(
            model,
            arguments.input,
            name=os.path.splitext(os.path.basename(arguments.output))[0],
            options=command_line.options(arguments, SimulateOptions),
        )
    counts = made.save(arguments.output, arguments.force, arguments.work)
    for line in formatted(_headline(arguments, model, made)):
        command_line.say(arguments, line)
    if made.stopped:
        say("identify simulate: the controller stopped: %s" % made.stopped, sys.stderr)
    return {
        "bag": arguments.output,
        "input": arguments.input,
        "sequence": made.sequence or None,
        "seed": arguments.seed,
        "disturbance": _described(made.disturbance),
        "duration": made.length,
        "messages": counts,
        "frames_not_delivered": made.frames_not_delivered,
        "bursts": made.bursts,
        "stopped": made.stopped or None,
        "tracking_error": made.tracking_error,
    }


def _headline(arguments: argparse.Namespace, model: Model, run: SimulatedRun) -> Iterator[Line]:
    """The first lines: what was recorded, and what to do next."""
    frames = "frame" if run.frames_not_delivered == 1 else "frames"
    counts = run.length, len(run.pose_times), run.frames_not_delivered, frames, len(run.control_times)
    yield "Simulated", "%.2f s, %d poses (%d %s not delivered), %d commands." % counts
    if run.sequence:
        yield "Input", "%s: %s" % (arguments.input, run.sequence)
    if run.marks:
        yield "Bursts", _bursts(run)
    if run.tracking_error is not None:
        yield "Distance", "%.3f m rms from the reference" % run.tracking_error
    yield "Recording", arguments.output
    if run.disturbance is None and not model.core.disturbance.empty():
        text = "simulate again with --disturbance, so that the disturbance of %s acts; or go on without it"
        yield "Next", text % arguments.model
    else:
        yield (
            "Next",
            "fit or diagnose it:\nrosrun ground identify diagnose %s --model MODEL -o diagnosis"
            % arguments.output,
        )


def _described(disturbance: Optional[_core.Disturbance]) -> Optional[Dict[str, object]]:
    """A disturbance for --json, SI units."""
    if disturbance is None:
        return None
    found = {name: list(getattr(disturbance, name)) for name in ("sigma", "time", "white", "trim")}
    return {**found, "trim_thrust": disturbance.trim_thrust}


def _bursts(run: SimulatedRun) -> str:
    """The bursts of an excitation in words."""
    times = [mark[0] for mark in run.marks] + [run.control_times[run.controls[:, -1] > 0][-1]]
    driven = sum(b - a for a, b, mark in zip(times, times[1:], run.marks) if mark[2])
    return "%d bursts, %.1f s of %.1f s; between them the craft returned home" % (
        sum(mark[2] for mark in run.marks),
        driven,
        times[-1] - times[0],
    )
