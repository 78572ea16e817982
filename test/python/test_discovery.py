"""A simulated craft finds its own physics: information, beliefs, and the steps of a discovery."""

import contextlib
import dataclasses
import json
import pathlib
import types

import numpy as np
import pytest

from conftest import MODEL, ROOT, schema
from ground import _core
from ground.analysis import candidates
from ground.analysis.likelihood import Likelihood
from ground.discovery import beliefs, campaign, choice, information, pieces, tracking
from ground.discovery.analyst import Analyst, Found
from ground.discovery.campaign import PAIRS, Discovery, Settings
from ground.discovery.journal import Journal
from ground.discovery.laboratory import Landed
from ground.discovery.simulated import SimulatedLaboratory
from ground.discovery.story import ABSENT, CONFIRM, GIVEN, OPEN, PRESENT, SLIGHT, TRACK, Story
from ground.errors import GroundError
from ground.reports import discovery_words
from ground.recordings.quality import repaired
from ground.simulation import experiments

pytestmark = pytest.mark.usefixtures("one_preparation")

SHARE, TIME = 0.005, 0.5  # disturbance: of full thrust, correlation time [s]


def given():
    return _core.load_model(str(MODEL))


def room():
    return _core.load_room(str(ROOT / "cfg" / "room" / "room_4x4.yaml"))


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


CURVED = {"thrust_curve": {"p": 1.4}}
COMPASS = {
    "name": "compass",
    "expression": {"N": "a*sin(psi+p)"},
    "parameters": {
        "a": {"value": 2.5e-4, "unit": "N m", "neutral": 0.0, "lower": -1, "upper": 1},
        "p": {"value": 0.7, "unit": "rad", "neutral": 0.7, "lower": -7, "upper": 7},
    },
}
SIDE_FORCE = {
    "name": "side_force_in_turns",
    "expression": {"Y": "a*r*u"},
    "parameters": {
        "a": {"value": 0.0047, "unit": "N s^2/m", "neutral": 0.0, "lower": -1, "upper": 1}
    },
}


@pytest.fixture(scope="module")
def analyst():
    return Analyst(given(), room(), 1)


@pytest.fixture(scope="module")
def curved(tmp_path_factory):
    """A whole discovery of a craft with a curved thrust: story, laboratory, stories as told."""
    folder = tmp_path_factory.mktemp("curved") / "discovery"
    folder.mkdir()
    told = []
    lab = laboratory(craft(**CURVED), folder)
    found = Discovery(
        given(), lab, folder=str(folder), told=lambda s: told.append(s.to_dict()), threads=1
    )
    return found.run(), lab, told, folder


# --- Information


def seen(analyst, *chosen):
    """{effect: visibility} of some pieces."""
    questions = analyst.start.questions
    offers = [o for o in analyst.first_offers if o.piece.words in chosen]
    assert len(offers) == len(chosen)
    visibility = questions.visibility(sum(offer.gain for offer in offers))
    return {q.about: v for q, v in zip(questions.asked, visibility)}


def test_what_inputs_do_not_excite_is_not_visible(analyst):
    full = seen(analyst, "PRBS of 10 Hz between 0 and 1 of full thrust")
    low = seen(analyst, "PRBS of 10 Hz between 0 and 1 of full thrust, lift at 0.6")
    # at full lift the skirt does not touch the floor; on-off inputs do not show a curve
    assert full["skirt_friction"] < 0.1 < 20 < low["skirt_friction"]
    assert full["thrust_curve"] < 0.1 and low["thrust_curve"] < 0.1
    assert seen(analyst, "random levels, 0.25 s each")["thrust_curve"] > 20


def test_visibility_is_the_expected_log_likelihood_ratio(analyst):
    # Experiments with the effect in the truth: the mean of 2 (L1 - L0) is visibility + 1.
    name, free = "thrust_curve", list(analyst.start.questions.basis.free)
    truth = given()
    truth.add_effect(name)
    truth.set_value("thrust_curve.p", 1 + 0.3 * analyst.sizes["thrust_curve.p"])
    piece = next(p for p in pieces.pieces(given(), 1) if p.words.startswith("random levels, 0.25"))
    rows = pieces.joined([piece, piece], 0.5)
    push = experiments.disturbance_in_shares(truth, SHARE, TIME)
    expected, ratios = [], []
    for seed in range(12):
        drive = experiments.as_given(rows, float(rows[-1, 0]))
        run = repaired(experiments.simulate(truth, drive, seed=seed, disturbance=push)).data(truth)
        box = Likelihood([run], truth, ())
        without = box.fit(given(), free)
        full = box.fit(truth, [*free, "thrust_curve.p"], near=without)
        ratios.append(2 * (full.log_posterior - without.log_posterior))
        known = information.of_runs(analyst.basis(without.model), box, full.levels)
        questions = dataclasses.replace(
            analyst.start.questions, asked=[information.Question(name)], scale=known.scale
        )
        expected.append(0.3**2 * questions.visibility(known.matrix)[0] + 1)
    error = np.std(ratios, ddof=1) / np.sqrt(len(ratios))
    assert np.mean(expected) > 10
    assert abs(np.mean(ratios) - np.mean(expected)) < 3 * error + 0.15 * np.mean(expected)


def test_the_first_flight_mixes_what_shows_all_effects(analyst):
    found = choice.Informed().choose(analyst.start, analyst.first_offers, 30.0, 1)
    words = " ".join(piece.words for piece in found.pieces)
    assert "lift at 0.6" in words
    shown = seen(analyst, *[piece.words for piece in found.pieces])
    poor = seen(analyst, "PRBS of 20 Hz between 0 and 1 of full thrust")
    decided = [sum(v >= information.DECIDED for v in one.values()) for one in (shown, poor)]
    assert decided[0] > decided[1] + 5


def test_more_flight_leaves_less_doubt(analyst):
    questions = analyst.start.questions
    matrix, doubts = 0 * analyst.start.information.matrix, []
    for offer in analyst.first_offers[:6]:
        doubts.append(questions.doubt(matrix))
        matrix = matrix + offer.gain
    assert doubts == sorted(doubts, reverse=True) and doubts[-1] < doubts[0] / 2


def test_pieces_are_played_inside_the_room(analyst):
    home, reach = np.array(room().home), room().clearance(room().home)
    for piece in pieces.pieces(given(), 3):
        run, seconds = pieces.motion(piece, given(), room(), 0.5, np.array([3e-4, 3e-4, 5e-3]))
        assert np.linalg.norm(np.array(run.eta)[:, :2] - home, axis=1).max() < reach
        assert seconds >= pieces.SECONDS


# --- A whole discovery


def test_it_finds_the_hidden_effect_and_confirms_it(curved):
    story, _, _, _ = curved
    assert (story.verdict, story.findings[-1].effects) == ("missing", ["thrust_curve"])
    excited = [f.seconds for f in story.flights if f.flight.purpose != TRACK]
    assert story.sure and story.ended and sum(excited) < 80 and story.flown < story.budget
    confirmation = story.confirmation
    assert confirmation.holds and confirmation.final <= confirmation.most
    assert "%.3f" % confirmation.most in confirmation.sentence
    # What the given model can do without the effect, fitted to the same flights, is the honest "before".
    assert confirmation.final < confirmation.refitted < confirmation.given
    assert story.confirmation.final < 0.5 * story.confirmation.given
    last = story.flights[-1]
    assert last.flight.purpose == CONFIRM
    # neither fit nor choice has seen it
    assert story.findings[-1].after < last.flight.number
    assert all(version.after < last.flight.number for version in story.versions)


def test_the_error_falls_from_model_to_model(curved):
    story, _, _, _ = curved
    errors = story.flights[-1].errors
    assert list(errors) == [version.label for version in story.versions]
    last = story.findings[-1].label
    assert errors[last] < 0.5 * errors[GIVEN]
    assert errors[last] < 1.3 * story.flights[-1].floor


def test_beliefs_start_equal_and_end_decided(curved):
    story, _, _, _ = curved
    last = {belief.effect: belief for belief in story.findings[-1].beliefs}
    assert last["thrust_curve"].state == PRESENT and last["thrust_curve"].probability > 0.95
    others = [belief for name, belief in last.items() if name != "thrust_curve"]
    assert all(belief.state == ABSENT for belief in others)
    assert np.median([belief.probability for belief in others]) < 0.02


def test_what_acts_and_is_too_small_to_matter_is_not_believed_in(tmp_path):
    # With a short dead time, delay and lags act for certain, and move the craft by less than the noise.
    truth = craft(com_offset={"xg": 0.006, "yg": 0.0}, input_delay={"delay": 0.0008})
    settings = Settings(track=False)
    calm = SimulatedLaboratory(truth, given(), room(), folder=str(tmp_path))
    story = Discovery(given(), calm, settings, threads=1).run()
    finding = story.findings[-1]
    assert finding.effects == ["com_offset"] and story.sure
    believed = {b.effect for b in finding.beliefs if b.probability > 0.5}
    assert believed == {"com_offset"}
    states = {b.effect: b.state for b in finding.beliefs}
    assert states["input_delay"] == SLIGHT
    shares = {b.effect: b.share for b in finding.beliefs}
    assert shares["input_delay"] < 0.05 < shares["com_offset"]


def test_the_controllers_have_the_final_model_only_if_it_tracks_better(curved):
    story, lab, _, _ = curved
    check, flights = story.tracking, [f for f in story.flights if f.flight.purpose == TRACK]
    with_given, with_final = (
        [f.tracking_parts for f in flights if f.controlled_by == label] for label in (GIVEN, check.label)
    )
    assert 1 <= len(with_given) == len(with_final) <= PAIRS
    clear = tracking.evidence(with_given, with_final)
    assert check.decided == (abs(clear) > tracking.CLEAR)
    assert check.taken_back == (clear <= tracking.CLEAR)
    assert lab.believed.effects == ([] if check.taken_back else ["thrust_curve"])
    assert check.after < check.before


def test_it_stays_in_the_room(curved):
    story, _, _, _ = curved
    assert not any(flown.stopped for flown in story.flights)
    for flown in story.flights:
        assert min(room().clearance(np.array(point[1:])) for point in flown.path) > 0


def test_each_flight_is_planned_before_it_is_flown(curved):
    _, _, told, _ = curved
    planned = [s["planned"]["number"] for s in told if s["planned"]]
    assert sorted(set(planned)) == list(range(1, len(told[-1]["flights"]) + 1))
    first = next(s for s in told if s["planned"])
    assert first["planned"]["path"] and first["planned"]["why"]


def test_the_folder_keeps_all(curved):
    story, _, _, folder = curved
    kept = Journal(str(folder)).story()
    assert plain(kept) == plain(story)
    schema("discovery").validate(plain(kept))
    for flown in kept.flights:
        assert (folder / flown.recording).is_file()
        assert flown.flight.reference or (folder / flown.flight.inputs).is_file()
    for version in kept.versions:
        assert _core.load_model(str(folder / version.file)).effects == version.effects


class Broken(SimulatedLaboratory):
    """Is switched off in its third flight."""

    def fly(self, flight, inputs):
        if flight.number == 3:
            raise KeyboardInterrupt
        return super().fly(flight, inputs)


def test_an_interrupted_discovery_goes_on(curved, tmp_path):
    whole, _, _, _ = curved
    truth = craft(**CURVED)
    with pytest.raises(KeyboardInterrupt):
        Discovery(
            given(), laboratory(truth, tmp_path, kind=Broken), folder=str(tmp_path), threads=1
        ).run()
    assert len(Journal(str(tmp_path)).story().flights) == 2
    lab = laboratory(truth, tmp_path)
    story = Discovery(given(), lab, folder=str(tmp_path), threads=1).run()
    assert story.sure and story.findings[-1].effects == whole.findings[-1].effects
    assert [f.flight.number for f in story.flights] == list(range(1, len(story.flights) + 1))


def test_an_ended_discovery_is_not_flown_again(curved):
    story, lab, _, folder = curved
    again = Discovery(given(), lab, folder=str(folder), threads=1).run()
    assert plain(again) == plain(story)


def test_the_folder_of_another_model_is_refused(curved, tmp_path):
    _, lab, _, folder = curved
    other = given()
    other.set_value("m", 0.07)
    with pytest.raises(GroundError, match="another model"):
        Discovery(other, lab, folder=str(folder), threads=1)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(GroundError, match="new folder"):
        Discovery(given(), lab, folder=str(tmp_path), threads=1)
    (tmp_path / "notes.txt").rename(tmp_path / "journal.json")
    with pytest.raises(GroundError, match="not the story"):
        Discovery(given(), lab, folder=str(tmp_path), threads=1)


# --- Interruptions


class Killed(BaseException):
    """Ends a session as a loss of power does."""


class Power:
    """Lasts for some events of a session: changes of the folder or the controllers, flights, and what is
    told."""

    def __init__(self, events=10**9):
        self.left, self.used = events, 0

    def spend(self):
        if self.used == self.left:
            raise Killed
        self.used += 1

    def cuts(self, patch, kind, *names):
        """Patches methods of a class so that they need power."""
        for name in names:
            patch.setattr(kind, name, self.around(getattr(kind, name)))

    def around(self, method):
        def call(*arguments, **options):
            self.spend()
            return method(*arguments, **options)

        return call


def contents(folder):
    """What is in the folder of a discovery, without its recordings' and page's contents."""
    kept = {path.name: path.read_text() for path in folder.glob("*.[cyj]*")}
    return {**dict.fromkeys(path.name for path in folder.iterdir()), **kept}


def interrupted(begin, folder, lasts, kind=SimulatedLaboratory):
    """The story of a discovery whose power lasts for some events in each session; begin: makes it."""
    for events in lasts:
        power = Power(events)
        with pytest.MonkeyPatch.context() as patch:
            power.cuts(patch, Journal, "begin", "keep", "keep_inputs", "keep_model")
            power.cuts(patch, kind, "fly", "load")
            with contextlib.suppress(Killed):
                discovery = begin(folder)
                discovery.told = lambda _, power=power: power.spend()
                discovery.run()
    return power


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

    def __init__(self, *_):
        self.start, self.first_offers, self.formulas, self.depends = None, [], {}, ""
        self.past = 0.0

    def misread(self, _):
        return []

    def diagnose(self, recordings, reachable, seed):
        moved = sum(float(np.ptp(recording.eta[:, 0])) for recording in recordings)
        self.past = 0.5 * self.past + moved
        model = craft(yaw_bias={"n0": 1e-6 * self.past + 1e-8 * reachable + 1e-9 * seed})
        count = len(recordings)
        conclusion = types.SimpleNamespace(varies=[], memory=None, heldout=[0.1, 0.05], refits=())
        fit = types.SimpleNamespace(expected=10.0 if count > 4 else 1e-3)
        found = types.SimpleNamespace(
            fit=fit, chosen=[types.SimpleNamespace(name="yaw_bias")], steps=[]
        )
        state = types.SimpleNamespace(open=[], beliefs=[])
        return types.SimpleNamespace(
            diagnosis=found, conclusion=conclusion, state=state, offers=[], model=model,
            verdict="missing", asked=[], is_left_open=False, words={},
        )  # fmt: skip


class ShortChooser:
    """Chooses one piece for each flight."""

    def choose(self, state, offers, longest, seed):
        return choice.Chosen(choice.confirming(given(), seed)[:1], "It is short.")


def test_a_discovery_killed_anywhere_ends_as_if_it_had_not_been(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign.analyst, "Analyst", RoughAnalyst)
    monkeypatch.setattr(campaign.analyst, "expected_errors", lambda _, fit, *__, **___: [fit.expected])

    def begin(folder):
        folder.mkdir(exist_ok=True)
        lab = laboratory(craft(), folder, kind=SwiftLaboratory)
        return Discovery(given(), lab, folder=str(folder), chooser=ShortChooser(), threads=1)

    events = interrupted(begin, tmp_path / "whole", [10**9], SwiftLaboratory).used
    whole = contents(tmp_path / "whole")
    story = Journal(str(tmp_path / "whole")).story()
    assert story.sure and len(story.findings) > 2 and story.tracking is not None
    assert len([f for f in story.flights if f.flight.purpose == CONFIRM]) == 2  # the first one failed
    for last in range(events):
        folder = tmp_path / str(last)
        interrupted(begin, folder, [last, last % 13, 10**9], SwiftLaboratory)
        assert contents(folder) == whole, last


class OpenAnalyst(RoughAnalyst):
    """Leaves something: its flights cannot decide whether it is missing, or show that it is learnable."""

    verdict = "undecided"

    def diagnose(self, recordings, reachable, seed):
        found = super().diagnose(recordings, reachable, seed)
        found.diagnosis.chosen, found.conclusion.verdict = [], self.verdict
        found.conclusion.improved = found.model
        found.conclusion.ceiling = types.SimpleNamespace(said=True)
        found.state.questions = types.SimpleNamespace(basis=types.SimpleNamespace(columns={}))
        return Found(found.diagnosis, found.conclusion, found.state, [])


@pytest.mark.parametrize("verdict", ["undecided", "complete", "missing", "unexplained"])
def test_nothing_is_sure_or_confirmed_while_something_is_left(tmp_path, monkeypatch, verdict):
    monkeypatch.setattr(OpenAnalyst, "verdict", verdict)
    monkeypatch.setattr(campaign.analyst, "Analyst", OpenAnalyst)
    monkeypatch.setattr(campaign.analyst, "expected_errors", lambda *_, **__: [10.0])
    lab = laboratory(craft(), tmp_path, kind=SwiftLaboratory)
    settings = Settings(budget=50.0, track=False)
    story = Discovery(given(), lab, settings, chooser=ShortChooser(), threads=1).run()
    assert story.ended and not story.sure and story.verdict == verdict
    assert story.confirmation is None and story.needed
    said = " ".join(discovery_words.summary(story))
    assert "not sure" in said and "othing is missing" not in said
    assert ("cannot decide" in said) == (verdict == "undecided")


def test_what_was_proposed_before_an_interruption_is_tried_after_it(tmp_path):
    truth = candidates.from_entry(SIDE_FORCE, "the truth").add(craft())

    def begin(folder, told=lambda _: None):
        folder.mkdir(exist_ok=True)
        lab = laboratory(truth, folder, seed=3)
        return Discovery(given(), lab, Settings(track=False), str(folder), told, threads=1)

    whole = begin(tmp_path / "whole").run()
    assert whole.findings[-1].effects == ["proposed"] and len(whole.findings) > 1

    def kill(story):
        if len(story.findings) == len(whole.findings) - 1 and "diagnoses" in story.activity:
            raise Killed

    with pytest.raises(Killed):
        begin(tmp_path / "killed", kill).run()
    again = begin(tmp_path / "killed")
    assert plain(again.run()) == plain(whole)
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")
    assert again.models[again.story.versions[-1].label].format() == again.found.model.format()


# --- Crafts and rooms that do not go as planned


def test_a_craft_that_misses_nothing_is_complete():
    lab = laboratory(craft(), seed=2)
    story = Discovery(given(), lab, Settings(track=False), threads=1).run()
    assert (story.verdict, story.findings[-1].effects, story.sure) == ("complete", [], True)
    assert not any(flown.flight.purpose == TRACK for flown in story.flights)


class Grounded(SimulatedLaboratory):
    """Stops every flight before anything is measured."""

    def fly(self, flight, inputs):
        return Landed(None, "", 0.2, "the sender is disarmed")


def test_it_ends_when_nothing_can_be_flown():
    story = Discovery(given(), laboratory(craft(), kind=Grounded), threads=1).run()
    assert story.ended and not story.sure and len(story.flights) == 3
    assert "sender is disarmed" in story.reason


def test_it_ends_with_its_budget_and_says_what_is_open():
    lab = laboratory(craft(**CURVED))
    story = Discovery(given(), lab, Settings(budget=34.0, track=False), threads=1).run()
    assert story.ended and not story.sure and "budget" in story.reason
    flown = 0.0
    for flight in story.flights:  # none begins that is expected to exceed the budget
        assert flown + flight.flight.duration <= 34.0
        flown += flight.seconds
    assert flown == story.flown < 34.0 + 2.0


def test_it_can_be_stopped_and_gone_on(tmp_path):
    lab = laboratory(craft(**CURVED), tmp_path)
    found = Discovery(given(), lab, Settings(track=False), str(tmp_path), threads=1)
    found.told = lambda story: found.stop("stopped by hand") if story.flights else None
    story = found.run()
    assert story.ended and story.reason == "stopped by hand" and len(story.flights) == 1
    again = Discovery(given(), lab, Settings(track=False), str(tmp_path), threads=1).run()
    assert again.sure and again.findings[-1].effects == ["thrust_curve"]


class Refusing(SimulatedLaboratory):
    """Has controllers that take no other model."""

    def load(self, model, label):
        return "it has an effect that the controller cannot use" if label != GIVEN else ""


def test_controllers_that_refuse_a_model_keep_theirs():
    lab = laboratory(craft(**CURVED), kind=Refusing)
    story = Discovery(given(), lab, threads=1).run()
    assert story.sure and story.in_use == GIVEN and lab.believed.effects == []
    assert story.tracking is None  # there is nothing to compare


class Tracking(SimulatedLaboratory):
    """Tracks with errors of its own: (flights, parts) [m] with the given model, and with others."""

    def fly(self, flight, inputs):
        which = int(bool(self.believed.effects))
        parts = self.errors[which][self.tracked[which]]
        self.tracked[which] += 1
        return Landed(None, "", 15.0, "", list(parts))


def varied(seed, scale=1.0):
    """Errors in parts of three flights whose differences are chance."""
    return scale * np.exp(np.random.default_rng(seed).normal(0, 0.3, (3, tracking.PARTS)))


def compared(monkeypatch, analyst, before, after, budget=180.0):
    """Story and laboratory of a comparison with errors of tracking before and after."""
    monkeypatch.setattr(campaign.analyst, "Analyst", lambda *_: analyst)
    lab = laboratory(craft(), kind=Tracking)
    lab.errors, lab.tracked = (before, after), [0, 0]
    found = Discovery(given(), lab, Settings(budget=budget))
    found._track(GIVEN)
    found._add_version("final", craft(**CURVED))
    assert found._load("final") == ""
    while found._contender():
        found._check_tracking("final")
    return found.story, lab


def test_a_model_that_tracks_worse_is_taken_back(monkeypatch, analyst):
    even = 1 + 0.01 * (-1) ** np.arange(tracking.PARTS)
    story, lab = compared(monkeypatch, analyst, varied(1), varied(1, 1.1) * even)
    check = story.tracking
    assert check.decided and check.taken_back and "given model again" in check.sentence
    assert story.in_use == GIVEN and lab.believed.effects == []
    assert lab.tracked == [1, 1]


def test_a_model_is_kept_once_more_flights_show_that_it_tracks_better(monkeypatch, analyst):
    before = varied(1)
    after = [before[0][::-1], before[1] / 3, before[2] / 3]
    story, lab = compared(monkeypatch, analyst, before, after)
    assert lab.tracked == [2, 2] and story.tracking.decided and not story.tracking.taken_back
    assert story.in_use == story.tracking.label == "final" and lab.believed.effects


def test_models_that_track_alike_leave_the_given_one(monkeypatch, analyst):
    story, lab = compared(monkeypatch, analyst, varied(1), varied(2))
    check = story.tracking
    assert not check.decided and check.taken_back and "cannot be decided" in check.sentence
    assert lab.tracked == [PAIRS, PAIRS] and story.in_use == GIVEN and lab.believed.effects == []


def test_a_tracking_error_that_was_not_measured_says_nothing(monkeypatch, analyst):
    before, unknown = varied(1), []
    story, lab = compared(monkeypatch, analyst, before, [unknown, before[1] / 3, before[2] / 3])
    assert story.tracking.decided and not story.tracking.taken_back and story.in_use == "final"
    story, lab = compared(monkeypatch, analyst, before, [unknown] * PAIRS)
    assert not story.tracking.decided and story.in_use == GIVEN and lab.tracked == [PAIRS, PAIRS]
    assert "stopped" not in story.tracking.sentence and "not measured" in story.tracking.sentence


def test_a_comparison_leaves_time_for_the_confirming_flight(monkeypatch, analyst):
    story, lab = compared(monkeypatch, analyst, varied(1), varied(2), budget=79.0)
    assert lab.tracked == [1, 1] and not story.tracking.decided
    story, lab = compared(monkeypatch, analyst, varied(1), varied(2), budget=80.0)
    assert lab.tracked == [2, 2] and story.flown == 60.0
    story, lab = compared(monkeypatch, analyst, varied(1), varied(2), budget=29.0)
    assert lab.tracked == [1, 0] and "no time of flight is left" in story.tracking.sentence
    assert story.in_use == GIVEN


def test_the_evidence_of_a_comparison_is_a_statistic():
    """A model that tracks alike is kept rarely, one that halves the error nearly always."""
    random = np.random.default_rng(3)
    before, after = np.exp(random.normal(0, 0.3, (2, 2000, 1, tracking.PARTS)))
    alike = [tracking.evidence(*pair) for pair in zip(before, after)]
    half = [tracking.evidence(a, b / 2) for a, b in zip(before, after)]
    assert np.mean(np.array(alike) > tracking.CLEAR) < 0.03
    assert np.mean(np.array(half) > tracking.CLEAR) > 0.95
    assert tracking.evidence(before[0], before[0]) == 0


def test_errors_are_averaged_over_parts_of_equal_time():
    times = np.arange(0, 15, 0.01)
    parts = tracking.in_parts(times, np.where(times < 7, 3.0, 1.0))
    assert parts[0] == pytest.approx(3.0) and parts[1:] == pytest.approx([1.0] * (tracking.PARTS - 1))
    assert tracking.in_parts(times[:300], times[:300]) == []  # never settled
    gap = (times < 8) | (times > 10)
    assert tracking.in_parts(times[gap], times[gap]) == []


def test_a_story_of_before_parts_were_kept_goes_on(monkeypatch, analyst, tmp_path):
    monkeypatch.setattr(campaign.analyst, "Analyst", lambda *_: analyst)
    lab = laboratory(craft(**CURVED), tmp_path)
    found = Discovery(given(), lab, folder=str(tmp_path), threads=1)
    found.told = lambda story: found.stop("stopped by hand") if story.flights else None
    story = found.run()
    document = plain(story)
    del document["flights"][0]["tracking_parts"]
    (tmp_path / "journal.json").write_text(json.dumps(document))
    old = Discovery(given(), lab, folder=str(tmp_path), threads=1)
    (flight,) = old.story.flights
    assert flight.flight.purpose == TRACK and flight.tracking_parts == []
    assert old._tracks(GIVEN) == []  # it has nothing to compare


class Swapped(SimulatedLaboratory):
    """Records left and right swapped."""

    def fly(self, flight, inputs):
        landed = super().fly(flight, inputs)
        controls = landed.recording.controls[:, [1, 0, 2]]
        return dataclasses.replace(
            landed, recording=dataclasses.replace(landed.recording, controls=controls)
        )


def test_misread_recordings_end_it():
    story = Discovery(given(), laboratory(craft(), kind=Swapped), threads=1).run()
    assert story.ended and story.verdict == "misread" and not story.findings[-1].effects
    assert story.in_use == GIVEN and "swapped" in story.reason


def test_a_story_is_read_as_it_was_written(curved):
    story, _, told, _ = curved
    for document in [*told[:: max(1, len(told) // 5)], story.to_dict()]:
        read = json.loads(json.dumps(document))
        assert plain(Story.from_dict(read)) == read
    assert story.findings[0].beliefs[0].state in (OPEN, PRESENT)


@pytest.mark.parametrize(
    "hidden, formula, words",
    [
        (SIDE_FORCE, "Y = c1*(u*r)", "A force to the side that depends on the velocity"),
        (COMPASS, "N = c1*(sin(psi+", "A moment of up to 0.25"),
    ],
)
def test_what_no_effect_explains_becomes_a_formula_in_words(hidden, formula, words):
    truth = candidates.from_entry(hidden, "the truth").add(craft())
    lab = laboratory(truth, seed=3)
    story = Discovery(given(), lab, Settings(track=False), threads=1).run()
    first, last = story.findings[0], story.findings[-1]
    assert first.verdict == "unexplained" and "it may be a" in discovery_words.verdict_of(first)
    assert last.effects == ["proposed"] and story.confirmation.holds and story.sure
    assert any(formula in sentence for sentence in last.sentences)
    said = discovery_words.summary(story, given())[0]
    assert said.startswith(words) and said.endswith("(proposed) is missing.")
    errors = story.flights[-1].errors
    assert errors[last.label] < 0.7 * errors[first.label]
    assert errors[last.label] < 1.2 * story.confirmation.floor


def test_a_flight_separates_formulas_that_look_alike(analyst):
    """A moment that depends on the heading, or on the heading and the lift, after flights at full lift."""
    pair = [dict(COMPASS, name=name) for name in ("proposed", "proposed_2")]
    pair[1]["expression"] = {"N": "a*lift*sin(psi+p)"}
    first, second = (candidates.from_entry(entry, "a proposal") for entry in pair)
    basis = information.Basis.of(first.add(given()), [second], ["proposed_2.p"])
    offers = analyst.offers(basis, analyst.levels, 1)
    at_full_lift = [offer.gain for offer in offers if "lift" not in offer.piece.words]
    likelihood = Likelihood([analyst.overview], given(), ())
    scale = information.of_runs(basis, likelihood, analyst.levels).scale
    known = information.Information(sum(at_full_lift), np.zeros(len(basis.names)), scale)
    group = {"proposed": beliefs.Group({"proposed": 100.0, "proposed_2": 99.0}, 120.0)}
    later = 60 * information.mean_rate(offers)
    state = beliefs.after(group, (), basis, known, {"proposed_2.a": 1e-5}, later, 0.1)
    assert [(q.about, q.rival) for q in state.open if q.rival] == [("proposed", "proposed_2")]
    chosen = choice.Informed().choose(state, offers, 30.0, 1)
    assert "distinguish proposed or proposed_2" in chosen.why
    assert any("lift at 0.6" in piece.words for piece in chosen.pieces)
