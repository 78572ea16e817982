"""The experiment that would distinguish effects that recorded runs do not distinguish."""

import contextlib
import math
from dataclasses import replace
from typing import Any, List, Mapping, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis.likelihood import Likelihood, LikelihoodFit, call
from ground.analysis.thinning import thinned
from ground.diagnosing.report import NextExperiment, Planned
from ground.simulation import experiments
from ground.simulation.designs import Design, designs
from ground.support.annotations import Array, Each
from ground.support.errors import Diverged, GroundError
from ground.support.progress import Work

IN_ROOM = 16.0  # duration in a room, where returns take about half of it [s]
RATE = 120.0  # rate of the mocap [Hz]
MAX_REFITTED = 4  # experiments that are refitted
CLEAR_DISAGREEMENT = 6.0  # standard deviations that distinguish rivals in nearly all cases


def _options(design: Design, form: str) -> List[str]:
    """Options of a design; form: of a name and its values, with spaces between these."""
    return [
        form % (name, " ".join("%g" % v for v in np.ravel(value))) for name, value in design.options.items()
    ]


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
    rivals: Mapping[str, LikelihoodFit],
    runs: Sequence[_core.RunData],
    each: Each = map,
    room: Optional[_core.RoomPlan] = None,
    work: Optional[Work] = None,
) -> Optional[Planned]:
    """The experiment in which rivals, models that do the same on recorded runs, would diverge most.

    rivals: by name, their fits to the runs (_core.RunData). Each rival simulates each experiment that a
    lab can do, and the others have to explain its motion. The best are then repeated in the room (a
    _core.RoomPlan, by default 4 x 4 m), in bursts between returns home, with the rivals refitted to
    the old runs and the new one together. Rivals are sqrt(2 (L1 - L0)) standard deviations apart, with L
    the log-likelihood of the poses under a rival's own disturbance (ground.analysis.likelihood); the pair
    that is hardest to distinguish counts. each: maps over experiments; work: told of each.

    None when no experiment distinguishes the rivals.
    """
    fits = list(rivals.values())
    if not fits[0].model.is_pair:
        return None  # the experiments to choose from are for a left and a right thruster
    place, told = room or _core.RoomPlan(), work or Work()
    noise, runs = runs[0].noise, [thinned(run) for run in runs]  # once for all experiments
    choice = list(designs())

    def apart_on(design: Design) -> float:
        """Open loop, without the returns."""
        seconds = IN_ROOM / 2
        schedule = experiments.with_lift(design.rows(seconds), seconds, design.lift)
        return _disagreement(fits, schedule, noise)

    with told.stage("choosing the next experiment", len(choice)):
        apart = list(each(apart_on, choice))
    order = np.argsort([-a for a in apart], kind="stable")[:MAX_REFITTED]
    best, proposed, known = 0.0, choice[0], _costs(fits, runs, True)
    with told.stage("refitting to the best experiments", len(order)):
        for i in told.each(order.tolist()):
            # A refit brings rivals closer to each other, and clearer than clear is not needed.
            if best < min(apart[i], CLEAR_DISAGREEMENT):
                with contextlib.suppress(GroundError):  # it cannot be flown by this model
                    schedule = _schedule_in(choice[i], place, fits[0].model)
                    found = _disagreement(fits, schedule, noise, runs, known)
                    best, proposed = max((best, proposed), (found, choice[i]), key=lambda pair: pair[0])
    if best < 1:  # a standard deviation
        return None
    lift = "" if proposed.lift == 1.0 else " --lift %g" % proposed.lift
    played = " ".join(["--input %s" % proposed.kind, *_options(proposed, "--%s %s")]) + lift
    flown = " ".join(["design:=%s" % proposed.kind, *_options(proposed, "%s:='%s'")])
    flies = "roslaunch ground room_prbs.launch mocap_host:=ADDRESS %s lift:=%g duration:=%g"
    experiment = NextExperiment(
        separates=list(rivals),
        input=proposed.words,
        arguments=played,
        launch=flies % (flown, proposed.lift, IN_ROOM),
        room=place.name,
        repeat=math.ceil((CLEAR_DISAGREEMENT / best) ** 2),
        expected_disagreement=best,
    )
    return Planned(experiment, proposed.rows(IN_ROOM))


def _disagreement(
    rivals: Sequence[LikelihoodFit],
    schedule: experiments.Schedule,
    noise: Array,
    runs: Sequence[_core.RunData] = (),
    known: Any = 0.0,
) -> float:
    """Standard deviations that a new run puts between the two rivals that it distinguishes least.
    noise: of its poses; known: the rivals' costs of the runs, to refit them to these and the new run.
    0 when a rival's motion is not finite."""
    apart = []
    try:
        for i, true in enumerate(rivals):
            costs = _costs(rivals, [*runs, _run(true.model, schedule, noise)], bool(runs)) - known
            apart.append(np.delete(costs, i).min() - costs[i])
    except Diverged:
        return 0.0
    return float(np.sqrt(2 * max(0.0, min(apart))))


def _run(model: _core.Model, schedule: experiments.Schedule, noise: Array) -> _core.RunData:
    """A model's motion on a schedule, from rest, as _core.RunData. Poses have no noise added,
    so that the disagreement is a mean; `noise` is the level that they are given."""
    inputs = schedule.rows.copy()
    off = inputs[inputs[:, 3] > 0, 0].max() < inputs[:, 0]  # nothing after it is usable
    end = inputs[off, 0].min() if off.any() else schedule.end
    times = np.arange(experiments.LEAD, end, 1 / RATE)
    inputs[:, 1:3] *= model.input_max
    found = call(_core.simulate, model, inputs, times, np.zeros(3), np.zeros(3))
    return _core.RunData("new", times, found["eta"], found["nu"], inputs, found["eta"], noise)


def _costs(rivals: Sequence[LikelihoodFit], runs: Sequence[_core.RunData], refitted: bool) -> Array:
    """Negative log-likelihood of poses under each rival, as it is or refitted with its levels kept."""
    on, costs = Likelihood(runs, rivals[0].model), []
    for rival in rivals:
        near = replace(rival, loudness=())
        if refitted:
            costs.append(-on.fit(near.model, near.free, near=near, levels=False).log_posterior)
        else:
            costs.append(-sum(blocks.sum() for blocks in on.blocks(near)))
    return np.array(costs)
