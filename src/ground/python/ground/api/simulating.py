"""simulate: a recording of a simulated experiment."""

import os
from dataclasses import replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, TypeVar, Union

import numpy as np

from ground import _core
from ground.annotations import Document, Path
from ground.api.models import Model, ModelLike, Room, RoomLike
from ground.errors import GroundError, OptionError
from ground.recordings import run_settings
from ground.recordings.run_settings import AXES
from ground.simulation import experiments, gains
from ground.simulation import tracking as loop
from ground.simulation.experiments import SimulatedRun

DESIGNS = {info.name: info for info in _core.design_table()}
KINDS = [name for name in DESIGNS if name != "file"] + ["tracking"]
DURATION = 20.0  # [s]
WITH_RETURNS = 4  # longest experiment with bursts and returns, in lengths of the timed rows

# Options, by the part that they belong to.
MOCAP = (
    "rate",  # frames per second [Hz]
    "position_noise",  # noise of x and y, 1 sigma [m]
    "heading_noise",  # noise of psi, 1 sigma [rad]
    "latency",  # time from capture to delivery [s]
    "loss",  # share of single frames lost
    "gap_rate",  # losses of tracking per second [1/s]
    "gap_length",  # their mean duration [s]
)
LIFT = ("lift", "lift_time")
PATTERN = ("clock", "order", "levels", "hold", "rows_per_bit")
BURSTS = ("room", "burst")
# parameters of references and controllers that are options here
REFERENCE = [
    p for p in _core.reference_parameters() if p.name in ("size", "rate_of_turn", "petals", "speed")
]
GAINS = gains.CONTROLLERS["TrajectoryTracking"].parameters
TRACKING = (
    "controller",
    "reference",
    "origin",
    "end",
    "sharp",
    "controller_model",
    "max_error",
    "control_rate",
    *(parameter.name for parameter in REFERENCE + GAINS),
)
# Least and largest values
RANGES = {
    "duration": (0.1, experiments.LONGEST),
    "burst": (0.1, experiments.LONGEST),
    "lift": (0.0, 1.0),
    "lift_time": (0.0, 30.0),
    "clock": (0.1, 500.0),
    "hold": (0.02, 100.0),
    "levels": (-1.0, 1.0),
    "trim": (0.0, 0.3),
    "order": (2, 20),
}

_P = TypeVar("_P", bound=_core.DriveParams)
Options = Mapping[str, Any]
Disturbance = Union[bool, Tuple[float, float]]


def simulate(
    model: ModelLike,
    input: Path = "prbs",
    *,
    duration: Optional[float] = None,
    seed: int = 1,
    name: str = "simulated",
    start_pose: Sequence[float] = (0.0, 0.0, 0.0),
    start_velocity: Sequence[float] = (0.0, 0.0, 0.0),
    mocap: Optional[Mapping[str, float]] = None,
    disturbance: Union[Disturbance, Sequence[float]] = False,
    trim: Optional[float] = None,
    room: Optional[RoomLike] = None,
    controller_model: Optional[ModelLike] = None,
    axes: str = AXES,
    heading_offset: float = 0.0,
    **options: Any,
) -> SimulatedRun:
    """A recording of a simulated experiment, without ROS and faster than real time.

    model: the true model of the craft. input: a design ("prbs", "multilevel-prbs", "spin", ...:
    `identify simulate --help` lists them), "tracking" for a controller in the loop, or a CSV file of
    bits or timed rows. duration: length of the input [s] (20, or that of a file's rows). seed: for
    noise, losses, disturbance and the input. start_pose: x, y [m], psi [rad], world_ned;
    start_velocity: u, v
    [m/s], r [rad/s], body. mocap: rate [Hz], position_noise [m], heading_noise [rad], latency [s],
    loss (0..1), gap_rate [1/s], gap_length [s]. disturbance: True for that of the model, or the
    standard deviation of a random wrench as a share of full thrust and its correlation time [s].
    trim: differences from run to run, 1 sigma, in the same shares. room: bursts of the input
    between returns home, inside it. controller_model: the controller's model (default: model). axes,
    heading_offset: the mocap's, for `save`.

    options: lift (0..1), lift_time [s]; clock [Hz], order, levels (0..1, -1..1 for reversible
    thrusters), hold [s], rows_per_bit of a design; burst [s] in a room; controller, reference, origin,
    end ((x, y) [m]), sharp, max_error [m], control_rate [Hz], size [m], rate_of_turn [rad/s], petals,
    speed [m/s] and gains of a controller in the loop. OptionError when one does not go with the
    input, GroundError when nothing can be recorded.

    >>> run = ground.simulate(model_file, "prbs", duration=5, seed=3)
    >>> run
    <SimulatedRun simulated: 6.99 s, 700 poses, 401 commands>
    >>> run.truth_wrench.any()  # no disturbance acted
    False
    >>> ground.simulate(model_file, "prbs", burst=2)
    Traceback (most recent call last):
    ...
    ground.errors.OptionError: burst needs room
    """
    _check_ranges({**options, "duration": duration, "trim": trim})
    mover = Model.of(model)
    believed = None if controller_model is None else Model.of(controller_model)
    given = {**options, "room": room, "controller_model": controller_model}
    drive = _Drive(os.fspath(input), duration, seed, given, mover.core)
    acting = disturbance_on(mover, disturbance, trim)
    try:
        _core.AxisMapping(axes, heading_offset)
        run = experiments.simulate(
            mover.core,
            drive.params,
            name,
            start_pose,
            start_velocity,
            mocap_params(mocap or {}),
            seed,
            believed.core if believed else None,
            acting,
        )
    except ValueError as error:
        raise OptionError("{why}", why=error) from error
    return replace(
        run,
        axes=axes,
        heading_offset=heading_offset,
        sequence=drive.sequence,
        disturbance=acting,
        made_with=run_settings.document(drive.parameters(mover, believed or mover)),
    )


def _check_ranges(options: Options) -> None:
    for name, (low, high) in RANGES.items():
        for value in np.ravel([] if options.get(name) is None else options[name]):
            if not low <= value <= high:
                raise OptionError(
                    "{0}: {value:g} is not between {low:g} and {high:g}",
                    name,
                    value=value,
                    low=low,
                    high=high,
                )


class _Drive:
    """What drives the craft.

    Attributes: params, a Schedule or _core.DriveParams; sequence, one line on how a file of bits is
    played (else empty). OptionError when an option does not go with the input.
    """

    def __init__(
        self,
        kind: str,
        duration: Optional[float],
        seed: int,
        options: Options,
        craft: _core.Model,
    ) -> None:
        if kind not in KINDS and not kind.lower().endswith(".csv"):
            known = ", ".join(KINDS)
            raise OptionError(
                "'{kind}' is neither one of {known} nor a .csv file", kind=kind, known=known
            )
        self.kind, self._craft = kind, craft
        self.options = {n: v for n, v in options.items() if v is not None and v is not False}
        room = self.options.get("room")
        self.room = None if room is None else Room.of(room)
        self.sequence = ""
        self.params: experiments.Drive
        if kind == "tracking":
            self._refuse_unused(kind)
            self.params = self._tracking(duration or DURATION)
        else:
            self._play(seed, duration)

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
            raise OptionError("{why}", why=error) from error
        timed = kind == "file" and not signal.description  # rows under a header, not bits
        self._refuse_unused("lifted" if signal.has_lift else "timed" if timed else kind)
        length = duration or signal.end * (WITH_RETURNS if timed and self.room else 1)
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

    def _bursts(self, kind: str, options: Options, duration: float) -> _core.ExcitationParams:
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
        if "control_rate" in self.options:
            params.life.rate = self.options["control_rate"]
        return params

    def _tracking(self, duration: float) -> _core.TrackingParams:
        params = self._with_life(_core.TrackingParams(), duration)
        params.max_error = self.options.get("max_error", np.inf)
        params.controller.kind = self.options.get("controller", params.controller.kind)
        settings = self._given([parameter.name for parameter in REFERENCE])
        for option, names in loop.PLACES.items():
            settings.update(zip(names, self.options.get(option, ())))
        if "sharp" in self.options:
            settings["smooth"] = False
        try:
            gains.put(params.controller, self._given([parameter.name for parameter in GAINS]))
            params.reference = loop.reference(self.options.get("reference", "circle"), **settings)
        except GroundError as error:
            raise OptionError("{why}", why=error) from error
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
        known = [*PATTERN, *BURSTS, *TRACKING, *LIFT]
        for name in sorted(self.options, key=lambda n: known.index(n) if n in known else -1):
            if name not in known:
                raise OptionError("there is no option {0}", name)
            if name not in _takes(kind):
                raise OptionError(
                    "{0} does not go with {1} {input}", name, "input", input=self.kind
                )

    def parameters(self, mover: Model, believed: Model) -> Dict[str, Dict[str, str]]:
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
            controller["model"] = believed.path
        if self.room is not None:
            controller["room"] = self.room.path
        return {"controller": controller, "simulator": {"model": mover.path}}


def _takes(kind: str) -> List[str]:
    """Options that an input takes. Kinds "timed" and "lifted" are CSV files with a column time, and
    with a column lift as well."""
    if kind == "tracking":
        return [*TRACKING, *LIFT, "room"]
    if kind in ("timed", "lifted"):
        return [*BURSTS, *(LIFT if kind == "timed" else ())]
    return [*(name for name in DESIGNS[kind].takes if name in PATTERN), *LIFT, *BURSTS]


def mocap_params(settings: Mapping[str, float]) -> _core.MocapParams:
    """The _core.MocapParams with these settings."""
    params = _core.MocapParams()
    for name, value in settings.items():
        if name not in MOCAP:
            raise OptionError("mocap has no {name}", name=name)
        setattr(params, name, value)
    return params


def disturbance_on(
    model: Model, given: Union[Disturbance, Sequence[float]], trim: Optional[float]
) -> Optional[_core.Disturbance]:
    """The _core.Disturbance that acts; None where none does."""
    if given is False and trim is None:
        return None
    if given is True:
        found = model.core.copy().disturbance
        if found.empty():
            raise OptionError(
                "{0}: {model} has none; give SHARE and TIME",
                "disturbance",
                model=model.path or model.name,
            )
        if trim is None:
            return found
    elif given is False:
        found = _core.Disturbance()
    elif len(given) == 2 and 0 <= given[0] <= 1 and given[1] > 0:
        found = experiments.disturbance_in_shares(model.core, *given)
    else:
        raise OptionError(
            "{0} takes a SHARE between 0 and 1 and a positive TIME, or nothing, not {values}",
            "disturbance",
            values=" ".join("%g" % value for value in given),
        )
    own = experiments.disturbance_in_shares(model.core, trim=trim or 0.0)
    found.trim, found.trim_thrust = own.trim, own.trim_thrust
    return found
