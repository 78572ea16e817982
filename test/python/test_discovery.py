"""A simulated craft finds its own physics: one whole discovery as users run it, and its steps."""

import contextlib
import dataclasses
import json
import pathlib
import re
import shutil
import types

import numpy as np
import pytest
import yaml

import ground
from browsing import assert_fits, assert_sound, open_page
from conftest import MODEL, ROOT, fails, identify, json_of, schema, slow, succeeds
from conftest import nominal as given
from ground import _core
from ground.analysis.likelihood import Likelihood
from ground.discovery import answer, beliefs, campaign, choice, flights, information, tracking, words
from ground.discovery import page as discovery_page
from ground.discovery.analyst import Analyst
from ground.discovery.campaign import FlightCampaign
from ground.discovery.flights import CampaignSettings
from ground.discovery.journal import Journal
from ground.discovery.laboratory import Landed
from ground.discovery.simulated import SimulatedLaboratory
from ground.discovery.story import CONFIRM, GIVEN, PRESENT, SLIGHT, TRACK, Flown, Story, Version
from ground.effect_library import candidates
from ground.simulation import experiments

pytestmark = pytest.mark.usefixtures("one_preparation")

ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"
N0 = [{"name": "yaw_bias.n0", "value": 2e-4, "ci95": (1e-4, 3e-4), "unit": "N m", "identified": True}]
SHARE, TIME = 0.005, 0.5  # disturbance: of full thrust, correlation time [s]
OPTIONS = ["--room", ROOM, "--latency", 0.02, "--disturbance", SHARE, TIME, "--progress", "off"]
SIDE_FORCE = {
    "name": "side_force_in_turns",
    "expression": {"Y": "a*r*u"},
    "parameters": {"a": {"value": 0.0047, "unit": "N s^2/m", "neutral": 0.0, "lower": -1, "upper": 1}},
}


def room():
    return _core.load_room(str(ROOM))


def craft(**effects):
    """The given craft with other parameters, and effects {name: {parameter: value}}."""
    truth = given()
    for name, factor in (("I_z", 1.2), ("Y_v", 0.8), ("N_r", 1.25), ("k", 0.8)):
        truth.set_value(name, factor * truth.value(name))
    for name, parameters in effects.items():
        truth.add_effect(name)
        for parameter, value in parameters.items():
            truth.set_value("%s.%s" % (name, parameter), value)
    return truth


def laboratory(truth, folder="", seed=1, kind=SimulatedLaboratory):
    mocap = _core.MocapParams()
    mocap.latency = 0.02
    push = experiments.disturbance_in_shares(truth, SHARE, TIME)
    return kind(truth, given(), room(), mocap, push, seed, str(folder))


def plain(story):
    """A story as JSON gives it."""
    return json.loads(json.dumps(story.to_dict()))


# --- A whole discovery, as users run it


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("truth") / "truth.yaml"
    path.write_text(craft(motor_lag={"tau": 0.05}).format())
    return path


@pytest.fixture(scope="module")
def discovered(truth, tmp_path_factory):
    """What the verb has printed, its folder and its story."""
    out = tmp_path_factory.mktemp("discovered") / "found"
    result = succeeds("discover", "--model", MODEL, "--truth", truth, "-o", out, *OPTIONS)
    return result.stdout, out, Journal(str(out)).story()


def test_it_finds_the_hidden_effect_and_confirms_it(discovered):
    text, out, story = discovered
    assert (story.verdict, story.findings[-1].effects) == ("missing", ["motor_lag"])
    seconds = [flown.seconds for flown in excited(story)]
    assert story.sure and story.ended and sum(seconds) < 80 and story.flown < story.budget
    confirmation = story.confirmation
    assert confirmation.holds and confirmation.final <= confirmation.most
    # What the given model can do without the effect, fitted to the same flights, is the honest "before".
    assert confirmation.final < confirmation.refitted < confirmation.given
    last = story.flights[-1]
    assert last.flight.purpose == CONFIRM
    assert all(version.after < last.flight.number for version in story.versions)
    assert list(last.errors) == [version.label for version in story.versions]
    for at_first, final in zip(last.errors[GIVEN], last.errors[story.findings[-1].label]):
        assert final < 0.5 * at_first
    floors = [(off, flown.floor) for flown in story.flights if flown.floor for off in flown.errors.values()]
    assert len(floors) > 3
    for off, floor in floors:  # no model is better than the truth, but for chance
        assert off[0] > 0.8 * floor[0] and off[1] > 0.8 * floor[1]
    found = ground.Model.load(out / story.versions[-1].file)
    assert found["motor_lag.tau"] == pytest.approx(0.05, rel=0.1)
    assert re.search(r"Missing: +first-order lag .*motor_lag", text.split("\n\n")[-1])
    believed_in = {belief.effect: belief for belief in story.findings[-1].beliefs}
    believed = believed_in.pop("motor_lag")
    assert believed.state == PRESENT and believed.probability > 0.95
    assert np.median([belief.probability for belief in believed_in.values()]) < 0.02


def test_the_controllers_have_the_final_model_only_if_it_tracks_better(discovered):
    _, _, story = discovered
    check = story.tracking
    assert tracking.flown(story, GIVEN) and tracking.flown(story, check.label)
    assert check.decided and not check.taken_back and check.after < check.before
    assert story.in_use == check.label


def test_it_stays_in_the_room(discovered):
    _, _, story = discovered
    for flown in story.flights:
        assert min(room().clearance(np.array(point[1:])) for point in flown.path) > 0


def test_its_folder_has_all_that_it_tells(discovered):
    _, out, story = discovered
    document = json.loads((out / "journal.json").read_text())
    schema("discovery").validate(document)
    assert plain(Story.from_dict(document)) == document
    for flown in story.flights:
        assert len(ground.read(out / flown.recording)) == 1
        if not flown.flight.reference:
            head, *rows = (out / flown.flight.inputs).read_text().splitlines()
            assert head == "time,left,right,lift" and len(rows) > 5
    for version in story.versions:
        assert ground.Model.load(out / version.file).core.effects == version.effects
    page = (out / "report.html").read_text()
    assert "(motor_lag) is missing." in page and page.count("<summary>Flight ") == len(story.flights)


def test_the_same_command_adds_nothing_to_what_has_ended(discovered, truth):
    _, out, story = discovered
    again = json_of("discover", "--model", MODEL, "--truth", truth, "-o", out, *OPTIONS)
    assert again == plain(story) == json.loads((out / "journal.json").read_text())


def test_the_api_gives_the_result_as_a_table(discovered, truth):
    _, out, story = discovered
    told = []
    found = ground.discover(MODEL, truth, out, room=ROOM, told=told.append)
    assert found.confirmed and found.effects == ("motor_lag",)
    assert found.page == str(out / "report.html")
    frame = found.to_frame()
    assert list(frame.columns)[0] == "given" and frame.index.name == "flight"
    assert frame.iloc[-1][story.findings[-1].label] < 0.5 * frame.iloc[-1]["given"]
    assert "motor_lag" in repr(found) and found._repr_html_().count("<tr>") > 2
    assert told and told[-1].ended


def test_other_folders_are_left_alone(discovered, truth, tmp_path):
    _, out, _ = discovered
    arguments = ["--truth", truth, *OPTIONS, "-o"]
    fails(identify("discover", "--model", truth, *arguments, out), "discovery of another model")
    (tmp_path / "letter.txt").write_text("dear reader")
    fails(identify("discover", "--model", MODEL, *arguments, tmp_path), "files, but no journal.json")
    (tmp_path / "letter.txt").rename(tmp_path / "journal.json")
    fails(identify("discover", "--model", MODEL, *arguments, tmp_path), "is not a discovery")


def test_ctrl_c_is_told_and_the_same_command_continues(truth, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedLaboratory, "fly", interrupted)
    result = identify("discover", "--model", MODEL, "--truth", truth, "-o", tmp_path / "out", *OPTIONS)
    fails(result, "interrupted; the same command continues %s" % (tmp_path / "out"))


@pytest.mark.parametrize(
    "options, status, reason",
    [
        (["--budget", 0], 2, "0 is not between 1 and"),
        (["--loss", 2], 2, "loss"),
        (["--truth", "nowhere.yaml"], 1, "nowhere.yaml"),
        (["--room", "nowhere.yaml"], 1, "nowhere.yaml"),
        (["--disturbance"], 2, "none; give SHARE and TIME"),
    ],
)
def test_wrong_options_are_refused_before_the_first_flight(tmp_path, truth, options, status, reason):
    out = tmp_path / "out"
    given = ["--truth", truth] * ("--truth" not in options)
    result = identify("discover", "--model", MODEL, *given, "-o", out, *options)
    assert result.returncode == status
    assert reason in result.stderr.splitlines()[-1], result.stderr
    assert not out.exists()


# --- Its page


def excited(story):
    """The flights that play inputs, and do not track."""
    return [flown for flown in story.flights if flown.flight.purpose != TRACK]


def paged(story, folder, place):
    """Path of the page of a story that went through journal.json."""
    again = Story.from_dict(plain(story))
    return pathlib.Path(discovery_page.write(again, str(folder), place))


@pytest.fixture
def copied(discovered, tmp_path):
    """The folder of the discovery without its recordings, and its story."""
    _, out, _ = discovered
    shutil.copytree(out, tmp_path / "copy", ignore=shutil.ignore_patterns("*.bag"))
    return tmp_path / "copy", Journal(str(out)).story()


def test_its_page_shows_each_flight_as_planned_and_as_flown(discovered, browser):
    _, out, story = discovered
    names = open_page(browser, out / "report.html")
    assert len(names) == 1 + len(story.flights)  # errors; a figure of each flight
    assert_sound(browser, names)
    drawn, count = browser.execute_script(
        "const t = document.getElementById(arguments[0]).data;"
        "return [t.map(t => t.name), t.find(t => t.name === 'planned').y.length]",
        "figure%d" % excited(story)[0].flight.number,
    )
    assert drawn[:4] == ["walls", "planned", "flown", "start"] and count > 100
    assert "input, left" in drawn and "input, lift" in drawn


def unstarted(story):
    return Story("", "", 180.0)


def stopped(story):
    """The first flight was stopped before anything was recorded."""
    plan = dataclasses.replace(excited(story)[0].flight, path=[], why="")
    flights = [Flown(plan, "", 0.4, GIVEN, stopped="no pose for 0.5 s")]
    return Story(story.craft, story.room, 180.0, versions=story.versions[:1], flights=flights)


def unfinished(story):
    """All values that can be missing are: errors, floors, paths, tracking."""
    check = dataclasses.replace(story.tracking, before=None, after=None, taken_back=True)
    flights = [
        dataclasses.replace(flown, floor=None, path=[], errors=dict.fromkeys(flown.errors))
        for flown in story.flights
    ]
    findings = [dataclasses.replace(f, beliefs=[], sentences=[], open=[]) for f in story.findings]
    planned = dataclasses.replace(excited(story)[0].flight, number=len(flights) + 1)
    return dataclasses.replace(
        story, ended=False, confirmation=None, activity="diagnoses", tracking=check, flights=flights,
        findings=findings, planned=planned,
    )  # fmt: skip


def long(story):
    """Twenty flights, most of which change nothing."""
    first, made = excited(story)[0], dataclasses.replace(story)
    for number in range(len(story.flights) + 1, 21):
        label = "after flight %d" % number
        errors = {version.label: (22.0, 4.0) for version in made.versions}
        plan = dataclasses.replace(first.flight, number=number)
        made.versions = [*made.versions, dataclasses.replace(made.versions[-1], label=label, after=number)]
        made.flights = [*made.flights, dataclasses.replace(first, flight=plan, errors=errors)]
        made.findings = [*made.findings, dataclasses.replace(made.findings[-1], after=number, label=label)]
    return made


@pytest.mark.parametrize("change", [unstarted, stopped, unfinished, long], ids=lambda change: change.__name__)
def test_a_story_has_a_page_at_any_time(change, copied, browser, as_wide_as):
    folder, story = copied
    page = paged(change(story), folder, room())
    for width in (400, 1200):
        as_wide_as(width)
        names = open_page(browser, page)
        assert_fits(browser, width)
    assert_sound(browser, names)


def test_missing_and_damaged_files_are_left_out_of_a_page(copied):
    folder, story = copied
    assert "motor_lag.tau" in (folder / "report.html").read_text()
    (folder / story.versions[-1].file).write_text("nonsense")
    damaged, missing, *_ = [folder / flown.flight.inputs for flown in excited(story)]
    damaged.write_text("time,left,right,lift\n0,1,oops,1\n")
    missing.unlink()
    text = paged(story, folder, None).read_text()
    assert "Flight 3" in text and "motor_lag.tau" not in text


# --- What flights show


@pytest.fixture(scope="module")
def analyst():
    return Analyst(given(), room(), 1)


@pytest.mark.parametrize("part, state", [(0.5, SLIGHT), (2.0, PRESENT)])
@pytest.mark.parametrize("effect, parameter", [("input_delay", "delay"), ("yaw_bias", "n0")])
def test_what_is_smaller_than_what_matters_is_not_found(analyst, effect, parameter, part, state):
    """However certain it is: a loop's delay of a millisecond is seen in a minute of flight."""
    size = analyst.sizes["%s.%s" % (effect, parameter)]
    basis = analyst.basis(craft(**{effect: {parameter: part * size}}))
    known = information.of_runs(basis, Likelihood([analyst.overview], analyst.given, ()), analyst.levels)
    groups = {effect: beliefs.Group({effect: 0.0}, 500.0)}
    after = beliefs.after(groups, (), basis, known, analyst.sizes, known.matrix, 0.1)
    (found,) = [belief for belief in after.beliefs if belief.effect == effect]
    assert found.state == state and found.probability > 0.9


# --- Interruptions, with diagnoses that take no time


class Killed(BaseException):
    """Ends a session as a loss of power does."""


class Power:
    """Lasts for some events of a session: changes of the folder or the controllers, flights, and what is
    told."""

    def __init__(self, events):
        self.left, self.used = events, 0

    def spend(self):
        if self.used == self.left:
            raise Killed
        self.used += 1

    def around(self, method):
        def call(*arguments, **options):
            self.spend()
            return method(*arguments, **options)

        return call


def contents(folder):
    """What is in the folder of a discovery, without its recordings' contents."""
    kept = {path.name: path.read_text() for path in folder.glob("*.[cyj]*")}
    return {**dict.fromkeys(path.name for path in folder.iterdir()), **kept}


FLOWN = {}  # (bag, Landed, pose after it) of flights of SwiftLaboratory
EXPECTED = {}  # its paths


class SwiftLaboratory(SimulatedLaboratory):
    """Does not simulate the same flight twice."""

    def fly(self, flight, inputs):
        which = (flight.number, flight.reference, inputs.tobytes(), self.pose.tobytes())
        which += (self.believed.format(),)
        if which not in FLOWN:
            landed = super().fly(flight, inputs)
            bag = pathlib.Path(self.folder, landed.file).read_bytes()
            FLOWN[which] = bag, landed, self.pose
        bag, landed, self.pose = FLOWN[which]
        pathlib.Path(self.folder, landed.file).write_bytes(bag)
        return landed

    def expected(self, inputs, model):
        which = (inputs.tobytes(), self.pose.tobytes(), model.format())
        if which not in EXPECTED:
            EXPECTED[which] = super().expected(inputs, model)
        return EXPECTED[which]


class RoughAnalyst:
    """Finds something that depends on the flights, the time that is left, and its earlier diagnoses, as an
    Analyst does, but at once."""

    verdict, misreads, is_left_open = "missing", [], False

    def __init__(self, *_):
        self.start, self.first_offers, self.formulas, self.depends = None, [], {}, ""
        self.past = 0.0

    def misread(self, _):
        return self.misreads

    def diagnose(self, recordings, reachable, seed, work=None):
        moved = sum(float(np.ptp(recording.eta[:, 0])) for recording in recordings)
        self.past = 0.5 * self.past + moved
        model = craft(yaw_bias={"n0": 1e-6 * self.past + 1e-8 * reachable + 1e-9 * seed})
        before = types.SimpleNamespace(model=model)
        conclusion = types.SimpleNamespace(varies=[], prediction=None, before=before)
        fit = types.SimpleNamespace(expected=10.0 if len(recordings) > 4 else 1e-3, parameters=N0)
        found = types.SimpleNamespace(
            fit=fit, given=given(), chosen=[types.SimpleNamespace(name="yaw_bias")], steps=[]
        )
        state = types.SimpleNamespace(open=[], beliefs=[])
        return types.SimpleNamespace(
            diagnosis=found, conclusion=conclusion, state=state, offers=[], model=model,
            verdict=self.verdict, asked=[], is_left_open=self.is_left_open, words={},
        )  # fmt: skip


def short(state, offers, longest, seed):
    """One piece for each flight."""
    return choice.Chosen(choice.confirming(given(), seed)[:1], "It is short.")


@pytest.fixture
def swift(monkeypatch):
    """Makes a discovery whose diagnoses take no time."""
    read, known = flights.readers.read, {}

    def read_once(path):
        content = pathlib.Path(path).read_bytes()
        if content not in known:
            known[content] = read(path)
        return known[content]

    monkeypatch.setattr(flights.readers, "read", read_once)
    monkeypatch.setattr(campaign.analyst, "Analyst", RoughAnalyst)
    monkeypatch.setattr(campaign.analyst, "expected_errors", lambda _, fit, *__, **___: [fit.expected])
    monkeypatch.setattr(campaign.analyst, "expected_off", lambda *_: (1.0, 0.1))

    def begin(folder, settings=None, told=None, kind=SwiftLaboratory):
        folder.mkdir(exist_ok=True)
        lab = laboratory(craft(), folder, kind=kind)
        return FlightCampaign(given(), lab, settings, str(folder), told, choose=short, threads=1)

    return begin


def interrupted(begin, folder, lasts):
    """The story of a discovery whose power lasts for some events in each session; begin: makes it."""
    for events in lasts:
        power = Power(events)
        with pytest.MonkeyPatch.context() as patch:
            for kind, names in (
                (Journal, ("begin", "keep", "keep_inputs", "keep_model")),
                (SwiftLaboratory, ("fly", "load")),
            ):
                for name in names:
                    patch.setattr(kind, name, power.around(getattr(kind, name)))
            with contextlib.suppress(Killed):
                begin(folder, told=lambda _, power=power: power.spend()).run()
    return power


@slow
def test_a_discovery_killed_anywhere_ends_as_if_it_had_not_been(tmp_path, swift):
    events = interrupted(swift, tmp_path / "whole", [10**9]).used
    whole = contents(tmp_path / "whole")
    story = Journal(str(tmp_path / "whole")).story()
    assert story.sure and len(story.findings) > 2 and story.tracking is not None
    assert len([f for f in story.flights if f.flight.purpose == CONFIRM]) == 2  # the first one failed
    for last in range(1, events, 4):
        folder = tmp_path / str(last)
        interrupted(swift, folder, [last, last // 4, 10**9])
        assert contents(folder) == whole, last


@pytest.mark.parametrize("verdict", ["undecided", "missing"])
def test_nothing_is_sure_or_confirmed_while_something_is_left(tmp_path, swift, monkeypatch, verdict):
    monkeypatch.setattr(RoughAnalyst, "verdict", verdict)
    monkeypatch.setattr(RoughAnalyst, "is_left_open", True)
    story = swift(tmp_path, CampaignSettings(budget=50.0, track=False)).run()
    assert story.ended and not story.sure and story.verdict == verdict
    assert story.confirmation is None and story.needed
    said = dict(answer.lines(story, None))
    assert story.needed in said["Next"] and "Not confirmed" in said["Missing"]
    assert not said["Missing"].startswith("nothing is missing.")
    assert "a moment of 0.2 mN m turns the craft to the right" in said["Missing"].replace(
        "A moment", "a moment"
    )


def test_it_ends_with_its_budget(tmp_path, swift):
    story = swift(tmp_path, CampaignSettings(budget=34.0)).run()
    assert story.ended and not story.sure and "budget of 34 s is used up" in story.reason
    flown = 0.0
    for flight in story.flights:  # none begins that is expected to exceed the budget
        assert flown + flight.flight.duration <= 34.0
        flown += flight.seconds
    assert flown == story.flown < 34.0 + 2.0


def test_it_can_be_stopped_and_gone_on(tmp_path, swift):
    found = swift(tmp_path)
    found.told = lambda story: found.stop("stopped by hand") if story.flights else None
    story = found.run()
    assert story.ended and story.reason == "stopped by hand" and len(story.flights) == 1
    assert swift(tmp_path).run().sure


def test_misread_recordings_end_it(tmp_path, swift, monkeypatch):
    monkeypatch.setattr(RoughAnalyst, "misreads", ["left and right are swapped"])
    story = swift(tmp_path).run()
    assert story.ended and story.verdict == "misread" and not story.findings[-1].effects
    assert story.in_use == GIVEN and "swapped" in story.reason


class Grounded(SimulatedLaboratory):
    """Stops every flight before anything is measured."""

    def fly(self, flight, inputs):
        return Landed(None, "", 0.2, "the sender is disarmed")


def test_it_ends_when_nothing_can_be_flown(tmp_path, swift):
    story = swift(tmp_path, kind=Grounded).run()
    assert story.ended and not story.sure and len(story.flights) == 3
    assert "sender is disarmed" in story.reason


class Refusing(SwiftLaboratory):
    """Has controllers that take no other model."""

    def load(self, model, label):
        return "it has an effect that the controller cannot use" if label != GIVEN else ""


def test_controllers_that_refuse_a_model_keep_theirs(tmp_path, swift):
    story = swift(tmp_path, CampaignSettings(budget=40.0, track=False), kind=Refusing).run()
    assert len(story.versions) > 1 and story.in_use == GIVEN
    assert all(flown.controlled_by == GIVEN for flown in story.flights)


# --- Crafts that miss nothing, or what the library does not have


def test_a_craft_that_misses_nothing_is_complete():
    lab = laboratory(craft(), seed=2)
    story = FlightCampaign(given(), lab, CampaignSettings(track=False), threads=1).run()
    assert (story.verdict, story.findings[-1].effects, story.sure) == ("complete", [], True)
    assert not any(flown.flight.purpose == TRACK for flown in story.flights)


def test_recordings_whose_thrusters_are_swapped_look_misread(discovered, analyst):
    _, out, story = discovered
    right = ground.read([out / flown.recording for flown in excited(story)[:2]])
    swapped = [dataclasses.replace(one, controls=one.controls[:, [1, 0, 2]]) for one in right]
    assert analyst.misread(right) == []
    assert "swapped" in " ".join(analyst.misread(swapped))


@slow
def test_what_no_effect_explains_becomes_a_formula_in_words(tmp_path):
    """And is found again after a kill in the diagnosis that took it."""
    truth = candidates.from_entry(SIDE_FORCE, "the truth").add(craft())

    def kill(story):
        if story.findings and story.activity.startswith("diagnoses"):
            raise Killed

    def begin(told=None):
        lab = laboratory(truth, tmp_path, seed=3)
        return FlightCampaign(given(), lab, CampaignSettings(track=False), str(tmp_path), told, threads=1)

    with pytest.raises(Killed):
        begin(kill).run()
    found = begin()
    story = found.run()
    first, last = story.findings[0], story.findings[-1]
    assert first.verdict == "unexplained" and "it may be a" in words.verdict_of(first)
    assert last.effects == ["proposed"] and story.confirmation.holds and story.sure
    assert any("Y = c1*(u*r)" in sentence for sentence in last.sentences)
    said = dict(answer.lines(story, given()))["Missing"]
    assert said.startswith("a force to the right that depends on the velocity")
    errors = story.flights[-1].errors
    assert errors[last.label][0] < 0.7 * errors[first.label][0]
    assert story.confirmation.final < 1.2 * story.confirmation.floor
    assert found.models[story.versions[-1].label].format() == found.found.model.format()


# --- Which model tracks better


def varied(seed):
    """Errors in parts of a flight whose differences are chance."""
    return np.exp(np.random.default_rng(seed).normal(0, 0.3, tracking.PARTS))


def flown(parts, stopped=""):
    flight = tracking.planned(1, GIVEN, room())
    return Flown(flight, "", 15.0, GIVEN, stopped, tracking_parts=list(parts))


@pytest.mark.parametrize(
    "before, after, better",
    [
        (flown(varied(1)), flown(varied(1) / 3), 1),
        (flown(varied(1)), flown(varied(1) * 3), -1),
        (flown(varied(1)), flown(varied(2)), 0),  # their difference is chance
        (flown(varied(1)), flown(varied(1) / 3, "the fence"), -1),
        (flown([], "the fence"), flown(varied(1)), 1),
        (flown(varied(1)), flown([]), 0),  # nothing was measured
        (flown(varied(1)), None, 0),
    ],
)
def test_a_final_model_is_kept_only_if_flights_show_that_it_tracks_better(before, after, better):
    assert tracking.verdict(before, after) == better
    story = Story("craft", "room", 180.0, [Version(GIVEN, "", [], 0), Version("final", "", [], 1)])
    story.in_use = "final"
    assert tracking.is_due(story)
    story.tracking = tracking.check(story, "final", better, "")
    assert story.tracking.taken_back == (better <= 0) and story.tracking.decided == (better != 0)
    assert ("given model again" in story.tracking.sentence) == story.tracking.taken_back
    assert not tracking.is_due(story)


def test_the_evidence_of_a_comparison_is_a_statistic():
    """A model that tracks alike is kept rarely, one that halves the error nearly always."""
    random = np.random.default_rng(3)
    before, after = np.exp(random.normal(0, 0.3, (2, 2000, tracking.PARTS)))
    alike = [tracking.evidence(*pair) for pair in zip(before, after)]
    half = [tracking.evidence(a, b / 2) for a, b in zip(before, after)]
    assert np.mean(np.array(alike) > tracking.CLEAR) < 0.03
    assert np.mean(np.array(half) > tracking.CLEAR) > 0.95


# --- rviz


def test_the_texts_of_a_discovery_lie_in_the_default_view():
    pytest.importorskip("visualization_msgs")
    from ground.nodes import discovery_markers

    layout = yaml.safe_load((ROOT / "cfg/rviz/ground.rviz").read_text())
    view, window = layout["Visualization Manager"]["Views"]["Current"], layout["Window Geometry"]
    half = [(window["Height"] - 92) / 2, (window["Width"] - 32) / 2]  # without menu, tools and borders
    effects = sorted(candidates.effects())
    status = types.SimpleNamespace(
        beliefs=[1.0] * len(effects), belief_effects=effects, belief_states=["open"] * len(effects),
        effects=effects[:2], flown=40.0, budget=180.0, ended=False, reason="", activity="flies " * 60,
    )  # fmt: skip
    shown = discovery_markers.markers(status, _core.load_room(str(ROOM)), True).markers
    texts = [one for one in shown if one.text]
    assert len(texts) > len(effects)
    for one in texts:
        assert one.header.frame_id == view["Target Frame"] and one.frame_locked
        size = one.scale.z, one.scale.z * _core.text_width(one.text)
        for at, extent, most in zip((one.pose.position.x, one.pose.position.y), size, half):
            assert view["Scale"] * (abs(at) + extent / 2) < most, one.text
