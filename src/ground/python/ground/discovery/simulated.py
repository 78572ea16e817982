"""A simulated craft in a simulated room, without ROS."""

import contextlib
import os
import tempfile
from typing import Iterator, List, Optional, Sequence, cast

import numpy as np

from ground import _core
from ground.discovery import tracking
from ground.discovery.laboratory import Landed, lifted
from ground.discovery.story import Flight, Point
from ground.reading import readers
from ground.reading.recording import Recording
from ground.simulation import experiments, gains
from ground.simulation.simulated_run import SimulatedRun
from ground.support import files
from ground.support.annotations import Array
from ground.support.errors import core_errors


class SimulatedLaboratory:
    """A craft that moves by the model `truth`, in a room. folder: recordings are kept there as bags;
    empty: they are not. The craft stays where a flight has left it, unless the flight was stopped:
    then it is carried home. Disturbance and noise go on with other random numbers."""

    def __init__(
        self,
        truth: _core.Model,
        believed: _core.Model,
        room: _core.RoomPlan,
        mocap: Optional[_core.MocapParams] = None,
        disturbance: Optional[_core.Disturbance] = None,
        seed: int = 1,
        folder: str = "",
    ) -> None:
        self.truth, self.believed, self.room = truth, believed, room
        self.mocap, self.disturbance = mocap or _core.MocapParams(), disturbance
        self.seed, self.folder = seed, folder
        self.pose = np.array([*room.home, 0.0])

    def fly(self, flight: Flight, inputs: Array) -> Landed:
        """See Laboratory."""
        name = "flight-%02d" % flight.number
        with played(inputs, self.believed.channels) as path:
            drive: experiments.Drive = (
                self.tracking(flight) if flight.reference else excitation(self.room, inputs, path)
            )
            run = self.simulated(drive, name, flight.number)
        self.pose = run.truth_eta[-1].copy()
        if run.stopped:
            self.carry_home()
        file, recording = "", cast(Recording, run)
        if self.folder:
            file = name + ".bag"
            path = os.path.join(self.folder, file)
            run.save(path, True)
            recording = readers.read(path)  # to the last digit as a later session reads it
        rest = self.pose.tolist()
        return Landed(recording, file, lifted(run), run.stopped, tracking_parts(run), rest)

    def resume(self, rest: Sequence[float]) -> None:
        """See Laboratory."""
        if rest:
            self.pose = np.array(rest)

    def carry_home(self) -> None:
        """Carries the craft home, as a person does before arming again: near a wall the room would not
        let it move."""
        self.pose[:2] = self.room.home

    def simulated(self, drive: experiments.Drive, name: str, number: int) -> SimulatedRun:
        """The run of a flight from where the craft is. number: of the flight, for random numbers."""
        return experiments.simulate(
            self.truth, drive, name, self.pose.tolist(), mocap=self.mocap, seed=1000 * self.seed + number,
            believed=self.believed, disturbance=self.disturbance,
        )  # fmt: skip

    def tracking(self, flight: Flight) -> _core.TrackingParams:
        """The TrackingParams of a flight that follows a reference."""
        params = _core.TrackingParams()
        params.controller = gains.choice("ModelPredictive")
        params.reference.kind, params.reference.size = flight.reference, flight.size
        params.reference.x, params.reference.y = self.room.home
        params.duration, params.room = flight.duration, self.room
        return params

    def load(self, model: _core.Model, label: str) -> str:
        """See Laboratory."""
        refusal = str(_core.effect_use("ModelPredictive", model)["refusal"])
        if not refusal:
            self.believed = model
        return refusal

    def expected(self, inputs: Array, model: _core.Model) -> List[Point]:
        """See Laboratory."""
        with played(inputs, self.believed.channels) as path:
            params = excitation(self.room, inputs, path)
            return path_of(params, model, self.pose)


@contextlib.contextmanager
def played(inputs: Array, channels: Sequence[str]) -> Iterator[str]:
    """A CSV file of inputs that a design can play; an empty path without inputs."""
    if not len(inputs):
        yield ""
        return
    with tempfile.TemporaryDirectory(prefix="ground-") as folder:
        path = os.path.join(folder, "inputs.csv")
        files.write_csv(path, ",".join(["time", *channels]), inputs.tolist())
        yield path


def path_of(params: _core.ExcitationParams, model: _core.Model, pose: Array) -> List[Point]:
    """The path of an excitation of a craft that moves by a model. GroundError when it cannot be
    simulated."""
    mocap = _core.MocapParams()
    mocap.position_noise = mocap.heading_noise = 0.0
    with core_errors():
        log = _core.excite(model, model, params, pose, np.zeros(3), mocap, 1)
    rows = log["truth"]
    every = max(1, round(tracking.PATH_STEP * mocap.rate))
    return [(float(t), float(x), float(y)) for t, x, y in rows[::every, :3]]


def excitation(room: _core.RoomPlan, inputs: Array, path: str) -> _core.ExcitationParams:
    """The ExcitationParams that play a file of inputs in bursts between returns home."""
    params = _core.ExcitationParams()
    params.design = experiments.design_params("file", file=path)
    params.duration, params.room = experiments.WITH_RETURNS * float(inputs[-1, 0]), room
    params.life.lift_time = 0.0  # the inputs begin with lift alone
    return params


def tracking_parts(run: SimulatedRun) -> List[float]:
    """Root mean square distances of the measured from the reference's position in parts of the reference
    [m]; empty unless one was tracked to its end."""
    references = run.references
    if run.stopped or not len(references):
        return []
    at = np.minimum(np.searchsorted(run.pose_times, references[:, 0]), len(run.pose_times) - 1)
    off = run.eta[at, :2] - references[:, 1:3]
    return tracking.in_parts(references[:, 0] - references[0, 0], np.hypot(*off.T))
