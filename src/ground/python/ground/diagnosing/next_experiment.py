"""The experiment that would distinguish effects that recorded runs do not distinguish."""

import contextlib
import dataclasses
import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Union

import numpy as np

from ground import _core
from ground.analysis.likelihood import Fit, Likelihood, call
from ground.analysis.thinning import thinned
from ground.simulation import experiments
from ground.simulation.designs import Design, designs
from ground.support.annotations import Array, Document, Each
from ground.support.errors import GroundError
from ground.support.progress import Work

DURATION = 8.0  # duration of the thrust [s]
IN_ROOM = 16.0  # duration in a room, where returns take about half of it [s]
RATE = 120.0  # rate of the mocap [Hz]
MAX_REFITTED = 4  # experiments that are refitted
MIN_DISAGREEMENT = 1.0  # standard deviations between rivals that an experiment needs to be proposed
CLEAR_DISAGREEMENT = 6.0  # standard deviations that distinguish rivals in nearly all cases

CHOOSING = "choosing the next experiment"  # stage; unit: an experiment
REFITTING = "refitting to the best experiments"  # stage; unit: an experiment


@dataclass
class Rival:
    """One of several models that do the same on the recorded runs."""

    name: str
    fit: Fit  # the fit to the recorded runs


def _arguments(design: Design) -> str:
    """Arguments of identify simulate that play a design, without a room."""
    options = ["--%s %s" % (name, _listed(value)) for name, value in design.options.items()]
    lift = [] if design.lift == 1.0 else ["--lift %g" % design.lift]
    return " ".join(["--input %s" % design.kind] + options + lift)


def _launch(design: Design) -> str:
    """The command line that flies a design with the real craft in its room."""
    options = ["%s:='%s'" % (name, _listed(value)) for name, value in design.options.items()]
    options.append("lift:=%g duration:=%g" % (design.lift, IN_ROOM))
    command = "roslaunch ground room_prbs.launch mocap_host:=ADDRESS design:=%s %s"
    return command % (design.kind, " ".join(options))


def _listed(value: Union[float, List[float]]) -> str:
    return " ".join("%g" % v for v in value) if isinstance(value, list) else "%g" % value


def _schedule(design: Design) -> experiments.Schedule:
    """The Schedule of a design played open loop."""
    return experiments.with_lift(design.rows(DURATION), DURATION, design.lift)


def _schedule_in(design: Design, room: _core.RoomPlan, model: _core.Model) -> experiments.Schedule:
    """The Schedule of commands to a craft that moves by `model`, in a _core.RoomPlan: bursts and
    returns. GroundError when ModelPredictive cannot use the model or the motion is not finite."""
    params = _core.ExcitationParams()
    params.design = experiments.design_params(design.kind, **design.options)
    params.room, params.duration, params.life.lift = room, IN_ROOM, design.lift
    params.start, params.tail = experiments.LEAD, experiments.TAIL
    log = call(_core.excite, model, model, params, np.zeros(3), np.zeros(3), _core.MocapParams(), 1)
    return experiments.Schedule(log["commands"], log["frames"][-1, 0])


def propose(
    rivals: Sequence[Rival],
    runs: List[_core.RunData],
    each: Each = map,
    room: Optional[_core.RoomPlan] = None,
    work: Optional[Work] = None,
) -> Optional[Document]:
    """The experiment in which Rivals that explain the same runs would diverge most.

    runs: _core.RunData that the rivals were fitted to. Each rival simulates each experiment that a
    lab can do, and the others have to explain its motion. The best are then repeated in the room (a
    _core.RoomPlan, by default 4 x 4 m), in bursts between returns home, with the rivals refitted to
    the old runs and the new one together. Rivals are sqrt(2 (L1 - L0)) standard deviations apart, with L
    the log-likelihood of the poses under a rival's own disturbance (ground.analysis.likelihood); the pair
    that is hardest to distinguish counts. each: maps over experiments; work: told of each.

    Returns `separates` (names), `input` (a sentence), `arguments` (of identify simulate, open loop),
    `launch` (the line that flies it), `room` (its name), `rows` (time [s], left, right of the design),
    `repeat` (number of such runs for a clear decision), and `expected_disagreement` of one of them [standard
    deviations]. None when no experiment distinguishes the rivals.
    """
    if not rivals[0].fit.model.is_pair:
        return None  # the experiments to choose from are those of a left and a right thruster
    place, told = room or _core.RoomPlan(), work or Work()
    noise, runs = runs[0].noise, [thinned(run) for run in runs]  # once for all experiments
    choice = list(designs())
    with told.stage(CHOOSING, len(choice)):
        apart = list(each(lambda e: _disagreement(rivals, _schedule(e), noise), choice))
    order = np.argsort([-a for a in apart], kind="stable")[:MAX_REFITTED]
    best, proposed, known = 0.0, choice[0], _costs(rivals, runs, True)
    with told.stage(REFITTING, len(order)):
        for i in told.each(order.tolist()):
            # A refit brings rivals closer to each other, and clearer than clear is not needed.
            if best < min(apart[i], CLEAR_DISAGREEMENT):
                with contextlib.suppress(GroundError):  # it cannot be flown by this model
                    schedule = _schedule_in(choice[i], place, rivals[0].fit.model)
                    found = _disagreement(rivals, schedule, noise, runs, known)
                    best, proposed = max((best, proposed), (found, choice[i]), key=lambda pair: pair[0])
    if best < MIN_DISAGREEMENT:
        return None
    return {
        "separates": [rival.name for rival in rivals],
        "input": proposed.words,
        "arguments": _arguments(proposed),
        "launch": _launch(proposed),
        "room": place.name,
        "rows": proposed.rows(IN_ROOM).tolist(),
        "repeat": math.ceil((CLEAR_DISAGREEMENT / best) ** 2),
        "expected_disagreement": best,
    }


def _disagreement(
    rivals: Sequence[Rival],
    schedule: experiments.Schedule,
    noise: Array,
    runs: Sequence[_core.RunData] = (),
    known: Union[Array, float] = 0.0,
) -> float:
    """Standard deviations that a new run puts between the two rivals that it distinguishes least.
    noise: of its poses; known: the rivals' costs of the runs, to refit them to these and the new run.
    0 when a rival's motion is not finite."""
    apart = []
    try:
        for i, true in enumerate(rivals):
            new = _run(true.fit.model, schedule, noise)
            costs = _costs(rivals, [*runs, new], bool(runs)) - known
            apart.append(np.delete(costs, i).min() - costs[i])
    except GroundError:
        return 0.0
    return float(np.sqrt(2 * max(0.0, min(apart))))


def _run(model: _core.Model, schedule: experiments.Schedule, noise: Array) -> _core.RunData:
    """A model's motion on a schedule, from rest, as _core.RunData. Poses have no noise added,
    because the mean disagreement is wanted; `noise` is the level that they are given."""
    inputs = schedule.rows.copy()
    off = inputs[inputs[:, 3] > 0, 0].max() < inputs[:, 0]  # nothing after it is usable
    end = inputs[off, 0].min() if off.any() else schedule.end
    times = np.arange(experiments.LEAD, end, 1 / RATE)
    inputs[:, 1:3] *= model.input_max
    found = call(_core.simulate, model, inputs, times, np.zeros(3), np.zeros(3))
    return _core.RunData("new", times, found["eta"], found["nu"], inputs, found["eta"], noise)


def _costs(rivals: Sequence[Rival], runs: Sequence[_core.RunData], refitted: bool) -> Array:
    """Negative log-likelihood of poses under each rival, as it is or refitted with its levels kept."""
    on, costs = Likelihood(runs, rivals[0].fit.model), []
    for rival in rivals:
        near = dataclasses.replace(rival.fit, loudness=())
        if refitted:
            costs.append(-on.fit(near.model, near.free, near=near, levels=False).log_posterior)
        else:
            costs.append(-sum(blocks.sum() for blocks in on.blocks(near)))
    return np.array(costs)
