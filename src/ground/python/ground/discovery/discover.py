"""discover: a simulated craft finds its own physics."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Callable, Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from ground import _core
from ground.annotations import Document, Path
from ground.discovery import campaign, flights
from ground.discovery.simulated import SimulatedLaboratory
from ground.discovery.story import Story
from ground.errors import OptionError
from ground.models import Model, ModelLike, Room, RoomLike
from ground.progress import Progress, Work
from ground.results import Shown
from ground.simulating import simulate as simulating
from ground.simulation import experiments

if TYPE_CHECKING:
    import pandas

FLYING = "discovering"  # stage; unit: a second of flight
BUDGET = flights.Settings.budget  # longest time of flight [s]
REST = 2.0  # length of a simulation that checks the conditions [s]

Told = Callable[[Story], None]


@dataclass(frozen=True, repr=False)
class Discovery(Shown):
    """What a craft has found out about its own physics."""

    verdict: str  #: as of a Diagnosis; empty if no flight was diagnosed
    effects: Tuple[str, ...]  #: effects that the given model misses
    groups: Dict[str, List[str]]  #: effects that cannot be distinguished from a found one, itself first
    model: Model  #: the model with them, fitted to the flights
    sure: bool  #: whether nothing is open that a flight could show
    confirmed: bool  #: whether it has predicted a flight that neither fit nor choice has seen
    seconds: float  #: time of flight [s]
    story: Story  #: everything, flight by flight
    page: str  #: path of report.html; empty without a folder

    @property
    def sentences(self) -> List[str]:
        """What `identify discover` prints at its end."""
        from ground.discovery import words

        return words.summary(self.story, self.model.core)

    def to_dict(self) -> Document:
        """Plain values, as journal.json has them."""
        return self.story.to_dict()

    def to_frame(self) -> "pandas.DataFrame":
        """Error of each model (columns) on each flight that it predicted, and the floor, indexed by
        the number of the flight; NaN where a model was not there or is not finite."""
        import pandas

        labels = [version.label for version in self.story.versions]
        rows = [[*(flown.errors.get(label) for label in labels), flown.floor] for flown in self.story.flights]
        index = pandas.Index([f.flight.number for f in self.story.flights], name="flight")
        return pandas.DataFrame(rows, index, [*labels, "floor"], dtype=float)

    def lines(self) -> Iterator[str]:
        """What `identify discover` prints at its end."""
        yield from self.sentences


def discover(
    model: ModelLike,
    truth: ModelLike,
    folder: Path = "",
    *,
    room: Optional[RoomLike] = None,
    budget: float = BUDGET,
    seed: int = 1,
    track: bool = True,
    mocap: Optional[Mapping[str, float]] = None,
    disturbance: simulating.Disturbance = False,
    trim: Optional[float] = None,
    told: Optional[Told] = None,
    progress: Progress = None,
) -> Discovery:
    """A simulated craft finds its own physics: it flies, is diagnosed, chooses the flight that tells
    most about what is still open, and flies again, until no question is left.

    model: what is known of the craft; truth: the model by which it moves. folder: keeps recordings,
    models, journal.json and the page report.html after each step; the discovery of a folder is
    continued. room: where it flies (4 x 4 m). budget: longest time of flight [s]. seed: for noise,
    disturbance and inputs. track: also compares how the given and the final model track a reference.
    mocap, disturbance, trim: as for `simulate`; trim differs from flight to flight. told: called with
    the Story at each change; progress: called with a ground.progress.Report at each step. OptionError
    when an option is wrong, GroundError when the craft cannot fly, or the folder is not that of a
    discovery of this model.

    >>> craft = ground.Model.load(model_file).with_effect("yaw_bias", n0=1e-4)
    >>> found = ground.discover(model_file, craft, budget=60, track=False)
    >>> found.verdict, found.effects
    ('missing', ('yaw_bias',))
    >>> found.seconds <= 60 and abs(found.model["yaw_bias.n0"] - 1e-4) < 2e-5
    True
    """
    if not budget > 0:
        raise OptionError("{0}: {value:g} is not positive", "budget", value=budget)
    from ground.discovery import page  # slow to load

    given, mover, kept = Model.of(model), Model.of(truth), os.fspath(folder)
    plan = _usual_room() if room is None else Room.of(room).core
    params = simulating.mocap_params(mocap or {})
    acting = simulating.disturbance_on(mover, disturbance, trim)
    _check(mover.core, params, acting)
    laboratory = SimulatedLaboratory(mover.core, given.core, plan, params, acting, seed, folder=kept)
    work = Work.of(progress)
    settings = flights.Settings(budget, track, seed)
    place = os.path.join(kept, page.NAME) if kept else ""

    def listen(story: Story) -> None:
        if kept:
            page.write(story, kept, plan)
        work.reach(int(min(story.flown, story.budget)))
        if story.activity:
            work.note(story.activity)
        if told is not None:
            told(story)

    with work.stage(FLYING, round(budget)):
        flying = campaign.Discovery(given.core, laboratory, settings, kept, listen)
        listen(flying.story)
        story = flying.run()
    last = story.findings[-1] if story.findings else None
    final = story.versions[-1]
    return Discovery(
        verdict=story.verdict,
        effects=tuple(last.effects) if last else (),
        groups=dict(last.groups) if last else {},
        model=Model(flying.models[final.label], os.path.join(kept, final.file) if kept else ""),
        sure=story.sure,
        confirmed=story.confirmation is not None and story.confirmation.holds,
        seconds=story.flown,
        story=story,
        page=place,
    )


def _usual_room() -> _core.RoomPlan:
    room = _core.RoomPlan()
    room.name = "4 x 4 m"
    return room


def _check(truth: _core.Model, mocap: _core.MocapParams, acting: Optional[_core.Disturbance]) -> None:
    """Raises OptionError when a craft cannot be simulated in these conditions."""
    rest = experiments.as_given(np.zeros((1, 2 + len(truth.thrusters))), REST)
    try:
        experiments.simulate(truth, rest, mocap=mocap, disturbance=acting)
    except ValueError as error:
        raise OptionError("{why}", why=error) from error
