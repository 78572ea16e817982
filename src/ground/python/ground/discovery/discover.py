"""discover: a simulated craft finds its own physics."""

import argparse
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Callable, Dict, Iterator, List, Optional, Tuple

import numpy as np

from ground import _core
from ground.discovery import answer, campaign, flights, journal, words
from ground.discovery.simulated import SimulatedLaboratory
from ground.discovery.story import Story
from ground.models import Model, ModelLike, Room, RoomLike
from ground.simulation import experiments
from ground.simulation import simulate as simulating
from ground.support import command_line
from ground.support.annotations import Path
from ground.support.command_line import option, seed
from ground.support.docstrings import internal
from ground.support.errors import GroundError, OptionError
from ground.support.headline import Line
from ground.support.progress import Progress, Work
from ground.support.results import Plotted, Shown

if TYPE_CHECKING:
    import pandas

REST = 2.0  # length of a simulation that checks the conditions [s]
DETAILS = """
The craft flies bursts of inputs in a room, without ROS and faster than real time. All flights so far
are diagnosed, the controllers use the improved model, and the next flight is the one that is
expected to show most about the effects that are still open. When no question is left, an
independent test flight checks the result.

DIR keeps recordings, inputs, models, journal.json and, after each step, the page report.html. When
DIR contains a discovery of the same model, it is continued. A disturbance in the file of the true model
acts only with --disturbance.
"""

Told = Callable[[Story], None]


@dataclass(frozen=True)
class DiscoverOptions(simulating.Acting, simulating.Mocap):
    """Where a discovery flies, and for how long."""

    room: Optional[RoomLike] = option(None, "room in which it flies (4 x 4 m)", metavar="ROOM.yaml")
    budget: float = option(
        flights.CampaignSettings.budget,
        "longest flight time [s] (%(default)g)",
        range=(1.0, 1e5),
        metavar="S",
    )
    seed: int = option(
        1, "seed of the mocap's noise and losses, the disturbance, and the inputs (%(default)s)", type=seed
    )
    track: bool = option(
        True,
        "do not compare how the given and the final model track a reference",
        name="--no-track",
        action="store_false",
    )


@dataclass(frozen=True, repr=False)
class Discovery(Shown, Plotted):
    """The result of a discovery: what a craft has found out about its own physics.

    >>> craft = ground.Model.load(model_file).with_effect("yaw_bias", n0=1e-4)
    >>> found = ground.discover(model_file, craft, "discovered", budget=30, track=False)
    >>> ground.load("discovered").effects == found.effects
    True
    """

    verdict: str  #: verdict as in a Diagnosis; empty if no flight was diagnosed
    effects: Tuple[str, ...]  #: effects that the given model lacks
    groups: Dict[str, List[str]]  #: indistinguishable effects by found effect, itself first
    model: Model  #: the model with these effects, fitted to the flights
    sure: bool  #: whether no question is open that a flight could answer
    confirmed: bool  #: whether the model has predicted an independent test flight
    seconds: float  #: flight time [s]
    story: Story  #: all contents of journal.json, flight by flight
    page: str  #: path of report.html; empty without a folder

    @classmethod
    @internal
    def of(cls, story: Story, model: Model, page: str = "") -> "Discovery":
        """The result of a story; model: its newest; page: path of report.html."""
        last = story.findings[-1] if story.findings else None
        return cls(
            verdict=story.verdict,
            effects=tuple(last.effects) if last else (),
            groups=dict(last.groups) if last else {},
            model=model,
            sure=story.sure,
            confirmed=story.confirmation is not None and story.confirmation.holds,
            seconds=story.flown,
            story=story,
            page=page,
        )

    @classmethod
    @internal
    def load(cls, folder: Path) -> "Discovery":
        """What the discovery of a folder has found so far. GroundError when there is none."""
        place = os.path.abspath(os.fspath(folder))
        story = journal.read(os.path.join(place, journal.STORY))
        model = Model.load(os.path.join(place, story.versions[-1].file))
        page = os.path.join(place, "report.html")
        return cls.of(story, model, page if os.path.isfile(page) else "")

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as in journal.json."""
        return self.story.to_dict()

    def to_frame(self) -> "pandas.DataFrame":
        """Position errors [mm] of each model (columns) on each flight, and the noise floor, indexed by the
        number of the flight; NaN where a model did not exist yet or is not finite."""
        import pandas

        labels = [version.label for version in self.story.versions]
        rows = [
            [off and off[0] for off in [*(flown.errors.get(label) for label in labels), flown.floor]]
            for flown in self.story.flights
        ]
        index = pandas.Index([f.flight.number for f in self.story.flights], name="flight")
        return pandas.DataFrame(rows, index, [*labels, "floor"], dtype=float)

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what is missing, how much it matters, and what to do next."""
        return answer.lines(self.story, self.model.core, self.model.path, self.page)

    def details(self) -> Iterator[str]:
        """Lines of text: the confirmation, and how much better the model tracks."""
        yield from words.details(self.story)


@command_line.takes(DiscoverOptions)
def discover(
    model: ModelLike,
    truth: ModelLike,
    folder: Path = "",
    *,
    told: Optional[Told] = None,
    progress: Progress = None,
    options: DiscoverOptions,
) -> Discovery:
    """Lets a simulated craft find its own physics.

    The craft flies and is diagnosed; then it chooses the flight that is expected to show most about open
    questions, and flies again, until no question is left. `trim` differs from flight to flight.

    Parameters
    ----------
    model : Model or path
        The model to begin with: what is known of the craft.
    truth : Model or path
        The true model, by which the simulated craft moves.
    folder : path, optional
        Folder for recordings, models, journal.json and the page report.html, written after each step. A
        discovery that the folder contains is continued.
    told : callable, optional
        Called with the Story whenever it changes.

    Raises
    ------
    GroundError
        When an option is wrong, the craft cannot fly, or the folder is not from a discovery of this model.

    Examples
    --------
    >>> craft = ground.Model.load(model_file).with_effect("yaw_bias", n0=1e-4)
    >>> found = ground.discover(model_file, craft, budget=60, track=False)
    >>> found.verdict, found.effects
    ('missing', ('yaw_bias',))
    >>> found.seconds <= 60 and abs(found.model["yaw_bias.n0"] - 1e-4) < 2e-5
    True
    """
    from ground.discovery import page  # slow to load

    given, mover, kept = Model.of(model), Model.of(truth), os.fspath(folder)
    plan = _core.RoomPlan() if options.room is None else Room.of(options.room).core
    plan.name = plan.name or "4 x 4 m"
    params = options.params()
    acting = simulating.disturbance_on(mover, options.disturbance, options.trim)
    _check(mover.core, params, acting)
    laboratory = SimulatedLaboratory(mover.core, given.core, plan, params, acting, options.seed, folder=kept)
    work, settings = Work.of(progress), flights.CampaignSettings(options.budget, options.track, options.seed)

    def listen(story: Story) -> None:
        if kept:
            page.write(story, kept, plan)
        work.reach(int(min(story.flown, story.budget)))
        if story.activity:
            work.note(story.activity)
        if told is not None:
            told(story)

    with work.stage("discovering", round(options.budget)):  # a unit is a second of flight
        flying = campaign.FlightCampaign(given.core, laboratory, settings, kept, listen, work=work.quiet())
        listen(flying.story)
        story = flying.run()
    final = story.versions[-1]
    model = Model(flying.models[final.label], os.path.join(kept, final.file) if kept else "")
    return Discovery.of(story, model, os.path.join(kept, page.NAME) if kept else "")


def _check(truth: _core.Model, mocap: _core.MocapParams, acting: Optional[_core.Disturbance]) -> None:
    """Raises OptionError when a craft cannot be simulated in these conditions."""
    rest = experiments.as_given(np.zeros((1, 2 + len(truth.thrusters))), REST)
    try:
        experiments.simulate(truth, rest, mocap=mocap, disturbance=acting)
    except ValueError as error:
        raise OptionError("{why}", why=error) from None


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify discover."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    command_line.add_model(parser, "the model to begin with")
    parser.add_argument("--truth", metavar="T.yaml", required=True, help="true model of the craft")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder of the discovery")
    command_line.add_options(parser, DiscoverOptions)
    command_line.add_details(parser)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify discover; returns what --json prints."""

    def say(text: str) -> None:
        command_line.say(arguments, text)

    model = Model.load(arguments.model)
    try:
        found = discover(
            model,
            arguments.truth,
            arguments.output,
            told=words.Teller(say, model.core),
            options=command_line.options(arguments, DiscoverOptions),
            progress=arguments.work,
        )
    except KeyboardInterrupt:
        raise GroundError("interrupted; the same command continues %s" % arguments.output)
    say("")
    command_line.say_result(arguments, found, arguments.output)
    return found.to_dict()
