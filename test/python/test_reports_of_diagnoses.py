"""How a diagnosis decides about memory and differences between runs, what it reports, and fits that hold
out blocks, with fits that are made up."""
import contextlib
import dataclasses
import types

import numpy as np
import pytest
from test_sets_of_effects import NAMES, estimate, found_of
from test_statistics import model, run_data

from ground import _core
from ground.analysis import (
    candidates,
    diagnosis,
    diagnosis_report,
    horizon,
    memory,
    stages,
    study,
    trials,
    validation,
    varying,
)
from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import Fit, _from_neutral
from ground.errors import GroundError
from ground.recordings import windows

# --- memory beside effects


def fit_at(log_posterior, *effects):
    extended = model()
    for name in effects:
        extended = candidates.of_library(name).add(extended)
    free = tuple(p["name"] for name in effects for p in candidates.parameters_of(extended, name))
    return types.SimpleNamespace(model=extended, free=free, log_posterior=log_posterior)


def remembering(
    monkeypatch, without, share=1.0, larger=True, may_go=lambda name: True, of_the_past=True
):
    """A Diagnosis with two effects whose memory was found; without: log-posteriors of the fits with memory
    and without effects, in the order in which they are asked for."""
    made = found_of({"yaw_bias": 100.0, "quadratic_drag": 60.0}, lambda names: 3.0)
    both = frozenset(["yaw_bias", "quadratic_drag"])
    with_memory = fit_at(200.0, *sorted(both))
    kind = types.SimpleNamespace(name="lag", constants=())
    found = memory.Memory.__new__(memory.Memory)
    vars(found).update(kind=kind, p_value=1e-9, fit=with_memory)
    monkeypatch.setattr(memory.Memory, "means", "it lags")
    monkeypatch.setattr(diagnosis.memory, "find", lambda likelihood, fit: found)
    left, asked = list(without), []

    def fit(given, free, near=None):
        asked.append((sorted(given.effects), free, near))
        return types.SimpleNamespace(model=given, free=free, log_posterior=left.pop(0))

    made.likelihood = types.SimpleNamespace(fit=fit)
    made.search.may_go = lambda fit, name: may_go(name)
    made.folds = types.SimpleNamespace(judge=lambda fit: "judged")
    made._larger = lambda with_it, rest: larger
    made.ceiling_of = lambda names: types.SimpleNamespace(may_remember=of_the_past)
    made.memory = None
    monkeypatch.setattr(diagnosis.held_out, "share_raised", lambda better, worse: share)
    return made, both, asked


def test_effects_that_memory_replaces_go_the_weakest_first(monkeypatch):
    made, both, asked = remembering(monkeypatch, [195.1, 190.0])
    assert made._with_memory(both) == {"yaw_bias"}  # ten are needed, from 2 (200 - 195.1) = 9.8 on
    assert [effects for effects, *_ in asked] == [["yaw_bias"], []]
    assert not any("quadratic_drag" in name for name in asked[0][1]) and asked[0][2].log_posterior == 200
    assert asked[1][2].log_posterior == 195.1  # beside what went before
    assert [(d.trial.name, d.why) for d in made.dropped] == [
        ("quadratic_drag", "it imitates a dependence on the past (lag)")
    ]
    assert made.memory.fit.log_posterior == 195.1
    made, both, asked = remembering(monkeypatch, [194.9, 190.0])
    assert made._with_memory(both) == both and made.dropped == []
    made, both, asked = remembering(monkeypatch, [199.0], may_go=lambda name: name == "yaw_bias")
    assert made._with_memory(both) == {"quadratic_drag"} and len(asked) == 1


def test_no_kind_of_memory_is_named_where_the_past_says_nothing(monkeypatch):
    made, both, asked = remembering(monkeypatch, [199.0, 198.0], of_the_past=False)
    assert made._with_memory(both) == both and made.memory is None and not asked


def test_memory_raises_three_quarters_of_the_parts_and_matters(monkeypatch):
    for share, larger, kept in ((0.75, True, True), (0.74, True, False), (1.0, False, False)):
        made, both, _ = remembering(monkeypatch, [199.0, 198.0], share, larger)
        said = []
        made.work.note = said.append
        found = made._with_memory(both)
        assert ("lag: it lags" in said) == kept
        assert (made.memory is not None) == kept
        assert found == (frozenset() if kept else both) and len(made.dropped) == 2 * kept
    monkeypatch.setattr(diagnosis.memory, "find", lambda likelihood, fit: None)
    assert made._with_memory(both) == both and made.memory is None


def test_the_search_is_repeated_while_differences_change(monkeypatch):
    kinds = [types.SimpleNamespace(kind=kind) for kind in varying.KINDS]
    for said, begun in (
        ([[], []], 0), ([kinds[:1], kinds[:1]], 1), ([kinds[:1], kinds[:2], kinds[:3], kinds[:4]], 3),
    ):  # fmt: skip
        made = diagnosis.Diagnosis.__new__(diagnosis.Diagnosis)
        answers, starts, last = list(said), [], said[min(begun, 2)]
        monkeypatch.setattr(
            diagnosis.varying, "differences", lambda varied, fit, answers=answers: answers.pop(0)
        )
        runs = []
        made.search = types.SimpleNamespace(
            run=lambda near=None, runs=runs: runs.append(near) or frozenset(["a"]),
            refused=lambda found: [frozenset(["a", "b"])],
            value=len,
            fits={frozenset(["a", "b"]): "likeliest", frozenset(["a"]): "other"},
            nominal=lambda: "nominal",
        )
        made.varied, made.differences = None, []
        notes = []
        made.work = types.SimpleNamespace(note=notes.append)

        def begin(differences, near, made=made, starts=starts):
            starts.append(near)
            made.differences = differences

        made._begin = begin
        assert made._likeliest_set() == {"a"}
        assert starts == ["nominal"] * begun and runs == [None] + ["likeliest"] * begun
        assert made.differences is last and len(notes) == begun  # those of the set that was found
        if begun:
            assert notes[0] == "differs between runs: surge force"
        if begun > 1:
            assert notes[1] == "differs between runs: surge force, side force"


def test_the_table_of_effects_may_be_short():
    made = found_of({"yaw_bias": 100.0, "quadratic_drag": 60.0, "momentum_drag": 1.0}, lambda names: 3.0)
    made.search.test_beside = lambda names: None
    for budget, names in ((None, ["yaw_bias", "quadratic_drag", "momentum_drag"]), (2, ["yaw_bias", "quad"])):
        made.budget = budget
        found = made._trials()
        assert len(found) == (3 if budget is None else 2)
        assert [t.name[:4] for t in found] == [name[:4] for name in names]
        assert all(t.refitted and t.seen for t in found)
        assert [t.gain for t in found] == [100.0, 60.0, 1.0][: len(found)]
        assert all(t.chance == min(1.0, 3 * t.p_value) for t in found)


def test_an_effect_is_seen_if_any_of_its_parameters_is_identified():
    made = found_of({"yaw_bias": 100.0}, lambda names: 3.0)
    fit = made.search.fits[frozenset(["yaw_bias"])]
    for identified, seen in (((True, True), True), ((False, True), True), ((False, False), False)):
        fit.parameters = [dict(name="yaw_bias.n%d" % i, identified=x) for i, x in enumerate(identified)]
        fit.parameters.append(dict(name="k", identified=True))
        found = made.trial_in(frozenset(["yaw_bias"]), "yaw_bias")
        assert found.seen == seen and len(found.parameters) == 2


def test_an_effect_that_was_not_refitted_has_the_step_of_its_test():
    made = found_of({"yaw_bias": 100.0}, lambda names: 3.0)
    made.budget = None
    made.candidates = [candidates.of_library("momentum_drag")]
    made.search.fits[frozenset()].model = model()
    for seen in (0.0029, 0.0031):
        made.search.test_beside = lambda names, seen=seen: types.SimpleNamespace(
            test=lambda names: (7.0, {"step": 1}),
            estimates=lambda craft, name, step: [dict(name=name, step=step)],
            seen=lambda name: seen,
        )
        (found,) = made._trials()
        assert (found.name, found.gain, found.refitted) == ("momentum_drag", 7.0, False)
        assert found.seen == (seen > 0.003) and "momentum_drag" in found.model.effects
        assert found.parameters == [dict(name="momentum_drag", step={"step": 1})]


def test_what_was_refused_is_dropped_with_its_reason():
    made = found_of({"yaw_bias": 100.0, "quadratic_drag": 60.0}, lambda names: 3.0)
    one, both = frozenset(["yaw_bias"]), frozenset(["yaw_bias", "quadratic_drag"])
    made.budget, made.memory, made.search.test_beside = None, None, lambda names: None
    made.search.refused = lambda found: [both]
    made.search.rivals = lambda names, name: ["momentum_drag"]
    made.search.value = lambda names: 1.0
    made._likeliest_set = lambda: one
    made._refuted = lambda better, found: "refuted" if better == both and found == one else None
    made._with_memory = made._without_stand_ins = lambda found: found
    made.grow()
    assert [(d.trial.name, d.why) for d in made.dropped] == [("quadratic_drag", "refuted")]
    assert made.names == one
    assert [(step.added, step.group) for step in made.steps] == [("yaw_bias", ("yaw_bias", "momentum_drag"))]
    assert [t.name for t in made.tried] == ["yaw_bias", "quadratic_drag"] and made.slight is None


# --- how a diagnosis begins


def begun_with(monkeypatch, runs, cores=2, **options):
    """A Diagnosis whose fits are stand-ins, and what these were asked."""
    asked = types.SimpleNamespace(likelihoods=[], folds=[], searches=[], studies=[])

    class Like:
        def __init__(self, runs, craft, varying=None, threads=1):
            self.runs, self.craft, self.varying, self.threads = runs, craft, varying, threads
            asked.likelihoods.append(self)

        def fit(self, craft, free, near=None):
            return "first fit", tuple(free)

    class Search:
        def __init__(self, fitting, each, plan, kept, holds):
            self.fitting, self.each, self.holds, self.fits = fitting, each, holds, {}
            asked.searches.append(self)

        def nominal(self, near):
            self.near = near
            self.fits[frozenset()] = types.SimpleNamespace(model=model())

    def folds(*given):
        asked.folds.append(given)
        return types.SimpleNamespace(judge=lambda fit: "judged", fold_of="folds")

    def of_runs(runs, **more):
        asked.studies.append(more)
        return types.SimpleNamespace(windows=["window"])

    kinds = [types.SimpleNamespace(kind=varying.KINDS[i]) for i in (0, 3)]
    monkeypatch.setattr(diagnosis, "Likelihood", Like)
    monkeypatch.setattr(diagnosis, "Search", Search)
    monkeypatch.setattr(diagnosis.held_out, "Folds", folds)
    monkeypatch.setattr(diagnosis.study, "Study", of_runs)
    monkeypatch.setattr(diagnosis.varying, "differences", lambda varied, fit: kinds)
    monkeypatch.setattr(diagnosis.os, "sched_getaffinity", lambda _: set(range(cores)))
    tried = [candidates.of_library("yaw_bias")]
    return diagnosis.Diagnosis(runs, model(), tried, **options), asked


def test_a_diagnosis_begins_with_all_differences_and_goes_on_with_those_found(monkeypatch):
    runs = [types.SimpleNamespace(times=np.zeros(n)) for n in (40, 60)]
    made, asked = begun_with(monkeypatch, runs, most=7)
    all_of_them, found = asked.likelihoods
    assert all_of_them.varying is None and found.varying == ["trim_X", "thrust"]
    assert made.varied is all_of_them and made.likelihood is found
    assert made.samples == 3 * 100  # 100 times x, y and heading
    assert asked.studies == [{"most": 7, "threads": 1}] and made.cut == ["window"]
    assert made.study.part_of == "folds"  # errors of all fits are over the same folds
    ((of, whole, craft, cut, each),) = asked.folds
    assert (of, whole, cut) == (runs, found, ["window"]) and craft is made.given and each == made.each
    (search,) = asked.searches
    assert search.near == ("first fit", ("I_z", "X_u", "Y_v", "N_r", "k"))
    assert list(search.fitting.candidates) == ["yaw_bias"] and made.nominal == "judged"
    assert search.fitting.criteria.refitted == 4
    made._refuted = lambda better, current: "why" if "bad" in better else None
    assert search.holds({"good"}, {}) and not search.holds({"bad"}, {})
    few, asked = begun_with(monkeypatch, runs, budget=2)
    assert asked.searches[0].fitting.criteria.refitted == 2


@pytest.mark.parametrize("cores,threads,workers,waiting,inside", [
    (3, 0, 3, 4, 0), (1, 0, 1, 1, 0), (3, 1, 1, 1, 1), (3, 2, 2, 4, 1),
])  # fmt: skip
def test_a_diagnosis_uses_as_many_threads_as_it_may(monkeypatch, cores, threads, workers, waiting, inside):
    """Fits alone use all cores (0) unless the threads are limited; one thread waits for one."""
    run = types.SimpleNamespace(times=np.zeros(9))
    made, asked = begun_with(monkeypatch, [run], cores, threads=threads)
    assert made.pool._max_workers == workers and made.waiting._max_workers == waiting
    assert made.threads == inside and {like.threads for like in asked.likelihoods} == {inside}
    assert made.each == made.pool.map == made.inside and made.each_of_many == made.waiting.map

    def each(function, items):
        return map(function, items)

    other, _ = begun_with(monkeypatch, [run], cores, threads=threads, each=each)
    assert other.each is other.each_of_many is each and other.inside is map  # workers have no threads


# --- the report


def judged(error, heldout):
    return types.SimpleNamespace(error=np.array([error, 0, 0.0]), heldout=np.array([0, heldout, 0.0]))


def trial(name, **more):
    found = trials.trial(
        name, candidates.of_library(name).add(model()), [estimate(name + ".p")], 20.0, True, True, 5, 100
    )
    return trials.replace(found, **more)


def test_the_slight_effect_is_reported_with_its_size():
    found = types.SimpleNamespace(slight=trial("yaw_bias", change=horizon.Change(1.0, 0.4, 0.1, 1.2)))
    report = diagnosis_report._slight(found)
    assert report["effect"] == "yaw_bias" and set(report["parameters"]) == {"p"}
    assert report["change"] == {"seconds": 1.0, "position_mm": 0.4, "heading_deg": 0.1, "relative": 1.2}
    assert report["p_value"] == found.slight.chance
    assert diagnosis_report._slight(types.SimpleNamespace(slight=None)) is None
    dropped = [trials.Dropped(trial("yaw_bias"), "why not")]
    (row,) = diagnosis_report._dropped(types.SimpleNamespace(dropped=dropped))
    assert (row["effect"], row["why"], row["p_value"]) == ("yaw_bias", "why not", dropped[0].trial.p_value)


def test_memory_is_reported_with_its_constants():
    for verdict in ("complete", "memory"):  # the past may matter without a kind
        none = types.SimpleNamespace(memory=None, verdict=verdict)
        assert diagnosis_report._memory(none) == {"found": verdict == "memory", "kind": None}
    kind = {kind.name: kind for kind in memory.kinds_of(model())}["spin_up"]
    one = types.SimpleNamespace(kind=kind, constants=(0.05, 0.02), means="so", p_value=1e-6)
    report = diagnosis_report._memory(types.SimpleNamespace(memory=one, verdict="memory"))
    assert report["found"] is True and report["kind"]["p_value"] == 1e-6
    assert report["kind"]["constants"] == [
        {"name": "rise", "value": 0.05, "unit": "s"}, {"name": "fall", "value": 0.02, "unit": "s"},
    ]  # fmt: skip


class Fits(dict):
    """The fit of any set, by the names in it."""

    def __missing__(self, names):
        return "+".join(sorted(names))


def planned(monkeypatch, groups=(), alike=(), runs=3, thorough=False, found=None):
    """The runs and rivals that the next experiment is planned with."""
    asked = []

    def propose(rivals, some, each, room, work):
        asked.append(([(r.name, r.fit) for r in rivals], some))
        return found and dict(found)

    monkeypatch.setattr(diagnosis_report.next_experiment, "propose", propose)
    made = types.SimpleNamespace(
        pool=types.SimpleNamespace(map=map), work=None, runs=list(range(runs)), fit="grown",
        names=frozenset(group[0] for group in groups),
        steps=[types.SimpleNamespace(added=group[0], group=group) for group in groups],
        search=types.SimpleNamespace(fits=Fits()),
    )  # fmt: skip
    report = diagnosis_report._next_experiment(made, alike, thorough, None)
    return report, asked


def test_the_next_experiment_distinguishes_the_first_group(monkeypatch):
    groups = [("a",), ("b", "c", "d"), ("e", "f")]
    report, ((rivals, runs),) = planned(monkeypatch, groups, found={"input": "x"})
    assert rivals == [("b", "a+b+e"), ("c", "a+c+e"), ("d", "a+d+e")] and runs == [0, 1, 2]
    assert report == {"input": "x"}
    assert planned(monkeypatch, [("a",)]) == (None, [])


def test_the_next_experiment_shows_what_these_runs_cannot(monkeypatch):
    alike = [types.SimpleNamespace(name=n, fit="with " + n, moved=("k", "X_u")) for n in "ab"]
    report, asked = planned(monkeypatch, [("c",)], alike, found={"input": "x"})
    assert asked == [([("a", "with a"), ("", "grown")], [0, 1, 2])]
    assert report == {"input": "x", "separates": ["a", "k", "X_u"]}
    report, asked = planned(monkeypatch, [], alike)  # neither can be shown
    assert report is None and [rivals[0][0] for rivals, _ in asked] == ["a", "b"]


def test_experiments_are_planned_with_six_runs(monkeypatch):
    for runs, thorough, used in (
        (6, False, range(6)), (7, False, [0, 1, 2, 3, 4, 5]), (12, False, [0, 2, 4, 6, 8, 10]),
        (12, True, range(12)),
    ):  # fmt: skip
        _, ((_, some),) = planned(monkeypatch, [("a", "b")], runs=runs, thorough=thorough)
        assert some == list(used)


def left_over(memory=None, formula=None, floor=1.0):
    """A Conclusion with something unexplained."""
    return types.SimpleNamespace(
        memory=memory, formula=formula, noise_floor=floor,
        ceiling=types.SimpleNamespace(arguments={"place": 0.9, "velocity": 0.2}),
    )  # fmt: skip


def test_what_is_unexplained_is_above_the_noise():
    found = types.SimpleNamespace(best=judged(2.0, 3.0), folds=None)
    for floor, fraction in ((1.0, 0.75), (2.0, 0.0), (3.0, 0.0)):
        report = diagnosis_report._unexplained(found, left_over(floor=floor))
        assert report["fraction"] == pytest.approx(fraction) and report["proposal"] is None
        assert [(w["variable"], w["share"]) for w in report["where"]] == [("place", 0.9), ("velocity", 0.2)]


@pytest.mark.parametrize("heldout, lower", [(2.9, True), (3.0, False)])
def test_only_what_lowers_the_error_on_held_out_runs_is_proposed(heldout, lower):
    found = types.SimpleNamespace(
        best=judged(2.0, 3.0), folds=types.SimpleNamespace(judge=lambda fit: judged(1.0, heldout))
    )
    lag = types.SimpleNamespace(entry={"name": "lag"}, fit=None)
    pull = types.SimpleNamespace(entry={"name": "proposed"}, fit=None, means="a force to a point")
    for left, name in ((left_over(memory=lag), "lag"), (left_over(formula=pull), "proposed")):
        proposal = diagnosis_report._unexplained(found, left)["proposal"]
        assert (proposal is not None) == lower
        if proposal:
            assert proposal["name"] == name and proposal["error"]["heldout"] == heldout
            assert proposal.get("means") == (None if name == "lag" else pull.means)
            assert set(diagnosis_report.effect_entry(proposal)) == {"name"}  # what model files know


def test_a_formula_whose_simulation_diverges_is_not_proposed():
    def judge(fit):
        raise GroundError("diverges")

    found = types.SimpleNamespace(best=judged(2.0, 3.0), folds=types.SimpleNamespace(judge=judge))
    pull = types.SimpleNamespace(entry={"name": "proposed"}, fit=None, means="a force to a point")
    assert diagnosis_report._unexplained(found, left_over(formula=pull))["proposal"] is None


@pytest.mark.parametrize("verdict", ["missing", "varies", "unexplained", "memory", "undecided", "misread"])
def test_a_report_is_completed_with_what_its_verdict_needs(monkeypatch, verdict):
    """Recordings that look misread show no effect that they could not show; what is left is described
    where something is."""
    staged, planned = [], []
    alike = [] if verdict == "misread" else ["alike"]
    monkeypatch.setattr(diagnosis_report.bands, "coverage", lambda bands: [bands])
    monkeypatch.setattr(diagnosis_report, "_candidates", lambda *of: list(of[1:]))
    monkeypatch.setattr(diagnosis_report, "_next_experiment", lambda *of: list(of[1:]))
    monkeypatch.setattr(diagnosis_report, "_unexplained", lambda found, conclusion: {"left": conclusion})
    made = types.SimpleNamespace(
        unseen=lambda: ["alike"], plan=types.SimpleNamespace(planned=lambda: planned.append(1)),
        work=types.SimpleNamespace(stage=lambda name: staged.append(name) or contextlib.nullcontext()),
    )  # fmt: skip
    concluded = types.SimpleNamespace(verdict=verdict, bands="bands")
    report = diagnosis_report.completed({"begun": 1}, made, concluded, True, "room")
    left = {"fraction": 0.0, "where": [], "proposal": None}
    assert report == {
        "begun": 1, "candidates": [alike, True], "bands": ["bands"],
        "next_experiment": [alike, True, "room"],
        "unexplained": {"left": concluded} if verdict in ("unexplained", "memory", "undecided") else left,
    }  # fmt: skip
    assert len(planned) == 1 and staged == [stages.ERRORS]
    quick = diagnosis_report.completed({}, made, concluded)
    assert quick["candidates"] == [alike, False] and quick["next_experiment"] == [alike, False, None]


def test_the_best_three_effects_have_errors():
    names = [*NAMES]
    found = types.SimpleNamespace(
        tried=[trial(name) for name in names], chosen=[], steps=[], judged_of=lambda t: judged(1, 2)
    )
    rows = diagnosis_report._candidates(found, [], False)
    assert [row["error"]["fit"] is not None for row in rows] == [i < 3 for i in range(len(names))]


# --- differences between runs


class Levels:
    """A likelihood of three runs whose fits have given levels, trims and gains."""

    def __init__(self, sizes, doubts, gains, times=None, duration=10.0):
        run = types.SimpleNamespace(times=[0.0, duration])
        self.runs, self.asked = [run] * 3, []
        self.sizes, self.doubts, self.gains = sizes, doubts, gains
        self.times = times or {}
        start = {kind.level: 0.5 for kind in varying.KINDS}
        self.box = types.SimpleNamespace(start=lambda craft: types.SimpleNamespace(levels=start))

    def fit(self, craft, free, near=None, held=None):
        self.asked.append((craft.effects, free, near.levels, dict(held or {})))
        levels = {kind.level: 1.0 for kind in varying.KINDS}
        levels.update({kind.time: self.times.get(kind.time, 1.0) for kind in varying.KINDS if kind.time})
        levels.update(held or {})
        without = [k for k in varying.KINDS if k.level in (held or {})]
        lost = sum(self.gains[varying.KINDS.index(k)] for k in without) / 2
        trims = [
            dict(wrench=s[:3], thrust=s[3], wrench_sigma=self.doubts[:3], thrust_sigma=self.doubts[3])
            for s in self.sizes
        ]
        by_run = np.array([-lost / 3] * 3)
        return dataclasses.replace(
            GIVEN, model=craft, free=free, levels=levels, trims=tuple(trims), by_run=by_run
        )


NONE = np.zeros(0)
GIVEN = Fit(
    model(), {kind.level: 0.0 for kind in varying.KINDS}, (), ("k",), 0.0,
    NONE, NONE, NONE, (), NONE, (), True,
)  # fmt: skip
SIZES = [[0.1, 0.1, 0.1, 0.1], [-0.2, 0.2, 0.2, 0.2], [0.0, 0.1, 0.0, 0.1]]


def test_differences_are_tested_with_shared_forces_in_the_model():
    like = Levels(SIZES, [0.05] * 4, [60.0, 0.0, 16.2, 16.7])
    found = varying.differences(like, GIVEN)
    # Half of a chi squared, for four kinds: 1e-4 is at a ratio of 16.45.
    assert [d.kind.parameter for d in found] == ["surge force", "thrust"]
    assert found[1].p_value == pytest.approx(4 * 0.5 * chi_squared_above(16.7, 1))
    effects, free, near, held = like.asked[0]
    assert {"body_force_bias", "yaw_bias"} <= set(effects) and held == {}
    assert set(free) == {"k", "body_force_bias.x0", "body_force_bias.y0", "yaw_bias.n0"}
    assert all(near[kind.level] == 0.5 for kind in varying.KINDS)  # large enough to start from
    assert varying.differences(types.SimpleNamespace(runs=[1]), GIVEN) == ()


def test_differences_within_their_doubt_are_zero():
    like = Levels(SIZES, [0.21, 0.19, 0.3, 0.3], [60.0] * 4)
    assert [d.kind.parameter for d in varying.differences(like, GIVEN)] == ["side force"]
    assert len(like.asked) == 2  # nothing else is refitted


def test_slow_random_wrenches_are_differences():
    """A correlation time of three tenths of a run is the longest."""
    for time, held in ((2.9, {}), (3.1, {"time_X": pytest.approx(3.0)})):
        like = Levels(SIZES, [0.05, 9, 9, 9], [60.0] * 4, {"time_X": time})
        found = varying.differences(like, GIVEN)
        assert [d.kind.parameter for d in found] == ["surge force"]
        assert len(like.asked) == (3 if held else 2)
        assert like.asked[1][3] == held if held else like.asked[1][3]["trim_X"] < 1e-2
        assert set(like.asked[-1][3]) == {"trim_X", *held}


# --- errors of windows, and blocks


def test_calibrated_errors_are_those_of_trimmed_models():
    run, craft = run_data(6.0), model()
    cut = windows.cut([run])
    constants = np.array([[0.0, 0, 0, 0.0], [0.004, 0, 0, 0.05], [-0.004, 0, 0, -0.1]])
    times = np.array([-1.0, run.times[cut[1].first], run.times[cut[1].first] + 0.7])
    like = types.SimpleNamespace(varying=["trim_X"], constants=lambda fit, run: (times, constants))
    fit = types.SimpleNamespace(model=craft)
    found = study.calibrated_errors([run], cut, like, fit)
    for i, window in enumerate(cut):
        known = constants[np.flatnonzero(times <= run.times[window.first])[-1]]
        expected = study.window_errors([run], [window], study.trimmed(craft, known))[0]
        assert np.allclose(found[i], expected)
    early = types.SimpleNamespace(varying=["x"], constants=lambda fit, run: (times + 100, constants))
    plain = study.window_errors([run], cut, craft)
    assert np.allclose(study.calibrated_errors([run], cut, early, fit), plain)
    none = types.SimpleNamespace(varying=())
    assert np.allclose(study.calibrated_errors([run], cut, none, fit), plain)


@pytest.mark.parametrize("ratio,short", [(0.98, True), (0.995, False), (1.2, False)])
def test_shorter_windows_are_taken_if_they_lower_the_error_by_a_hundredth(monkeypatch, ratio, short):
    given = study.Study([run_data(9.0)], threads=1)
    asked = []
    monkeypatch.setattr(given, "_best", lambda starts, free, **options: {"model": "near"})
    monkeypatch.setattr(
        given, "_fit", lambda chosen, start, free, **more: asked.append((given.length, start, more["near"]))
        or {"width": 2.0},
    )  # fmt: skip
    errors = {windows.WINDOW: 1.0, windows.WINDOW / 3: ratio}
    monkeypatch.setattr(
        given, "_judged",
        lambda result, free, threads: types.SimpleNamespace(heldout=np.array([errors[given.length], 0, 0])),
    )  # fmt: skip
    told = []
    work = types.SimpleNamespace(step=lambda: told.append(1))
    found = given.fit(model(), ["k"], work=work)
    assert [one[1:] for one in asked] == [("near", True)] * 2  # from the best of all starts
    assert [one[0] for one in asked] == pytest.approx([windows.WINDOW, windows.WINDOW / 3])
    assert len(told) == 3 and given.width == 2.0
    assert given.length == pytest.approx(windows.WINDOW / 3 if short else windows.WINDOW)
    assert found.heldout[0] == (ratio if short else 1.0)


def test_each_part_of_a_study_is_held_out_once(monkeypatch):
    given = study.Study([run_data(9.0)], threads=1)
    given.width = 2.5
    fits = []

    def fit(chosen, start, free, **options):
        fits.append((list(chosen), start, options))
        return {"model": len(fits)}

    monkeypatch.setattr(given, "_fit", fit)
    monkeypatch.setattr(
        study, "window_errors",
        lambda runs, tested, craft: np.array([[craft, given.windows.index(w), 0.5] for w in tested]),
    )  # fmt: skip
    monkeypatch.setattr(study, "channel_errors", lambda runs, cut, craft: (cut, craft))
    states = ["state %d" % i for i in range(len(given.windows))]
    parameters = [dict(name="k", value=1.0), dict(name="l", value=2.0)]
    found = given._judged({"model": "whole", "initial": states, "parameters": parameters}, ["k"], 1)
    assert (found.model, found.error) == ("whole", (given.windows, "whole"))
    assert found.parameters == {p["name"]: p for p in parameters}
    assert len(fits) == 4
    for part, (chosen, start, options) in enumerate(fits):
        rest = [i for i, other in enumerate(given.part_of) if other != part]
        assert chosen == [given.windows[i] for i in rest] and start == "whole"
        assert options["initial"] == [states[i] for i in rest]
        assert (options["near"], options["threads"], options["width"]) == (True, 1, 2.5)
    rows = np.array([[1 + part, i, 0.5] for i, part in enumerate(given.part_of)])
    samples = [w.last - w.first + 1 for w in given.windows]
    assert np.allclose(found.heldout, np.average(rows, axis=0, weights=samples))
    assert np.allclose(found.by_window, rows.sum(axis=1))


def test_the_best_start_is_kept_and_all_may_fail(monkeypatch):
    given = study.Study([run_data(9.0)], threads=1)
    objectives = {"a": 3.0, "b": 1.0, "c": None, "d": 2.0}

    def fit(chosen, start, free, **options):
        if objectives[start] is None:
            raise GroundError("cannot simulate " + start)
        return {"objective": objectives[start], "model": start}

    monkeypatch.setattr(given, "_fit", fit)
    assert given._best("abcd", [])["model"] == "b"
    with pytest.raises(GroundError, match="cannot simulate c"):
        given._best("c", [])
    with pytest.raises(GroundError, match="there is no model to start from"):
        given._best([], [])


def test_refits_use_the_outliers_of_the_fit_before(monkeypatch):
    """Without one, they are estimated."""
    given = study.Study([run_data(9.0)], threads=1)
    asked = []
    monkeypatch.setattr(given, "_best", lambda starts, free, **options: asked.append(options))
    monkeypatch.setattr(given, "_judged", lambda result, free, threads: threads)
    for width in (None, 2.5):
        given.width = given.width if width is None else width
        assert given.refit([model()], ["k"]) == 1
    assert [(o["width"], o["near"], o["threads"]) for o in asked] == [(0.0, True, 1), (2.5, True, 1)]


def blocks_of(monkeypatch, lengths):
    """Blocks of that many windows each, numbered."""
    at, blocks = 0, []
    for length in lengths:
        some = [_core.Window(0, 10 * (at + i), 10 * (at + i) + 9 + i) for i in range(length)]
        blocks.append((some, some))
        at += length
    monkeypatch.setattr(validation, "_blocks", lambda runs, block, length: blocks)
    return blocks


def test_blocks_are_held_out_in_ten_folds_at_most(monkeypatch):
    for count, folds in ((2, 2), (10, 10), (12, 10)):
        blocks_of(monkeypatch, [1] * count)
        fitted = []

        def fit(cut, initial, fitted=fitted):
            fitted.append(sorted(w.first // 10 for w in cut))
            return {"model": len(fitted), "initial": ["s%d" % (w.first // 10) for w in cut]}

        errors = []

        def error(runs, craft, cut, errors=errors):
            errors.append(craft)
            return float(len(cut))

        monkeypatch.setattr(validation.windows, "error", error)
        told = []
        work = types.SimpleNamespace(more=told.append, each=lambda items: items)
        found = validation.leave_blocks_out([], ["given"], fit, work=work)
        assert told == [folds]
        assert found["blocks"] == count and found["folds"] == folds and len(fitted) == 1 + folds
        assert fitted[0] == list(range(count))
        for fold, left in enumerate(fitted[1:]):
            assert left == [i for i in range(count) if i % 10 != fold]
        assert errors == [*range(2, 2 + folds), "given"] and found["models"] == [count]
    blocks_of(monkeypatch, [1])
    assert validation.leave_blocks_out([], [], fit) is None


def test_the_error_of_blocks_is_weighed_by_their_samples(monkeypatch):
    blocks_of(monkeypatch, [1, 3])
    given = {1: 2.0, 3: 5.0}
    monkeypatch.setattr(validation.windows, "error", lambda runs, craft, cut: given.get(len(cut), 0.0))
    fit = lambda cut, initial: {"model": None, "initial": [None] * len(cut)}  # noqa: E731
    found = validation.leave_blocks_out([], [], fit)
    samples = 10, 10 + 11 + 12
    assert found["heldout"] == pytest.approx((2 * samples[0] + 5 * samples[1]) / sum(samples))


def test_runs_are_held_out_in_twenty_folds_at_most(monkeypatch):
    monkeypatch.setattr(
        validation.windows, "cut", lambda runs, length: [_core.Window(i, 0, 9) for i in range(len(runs))]
    )
    monkeypatch.setattr(validation.windows, "error", lambda runs, craft: (runs[0], craft))
    for count in (20, 23):
        fitted = []

        def fit(cut, initial, fitted=fitted):
            fitted.append({w.run for w in cut})
            return {"model": len(fitted) - 1}

        found = validation.leave_runs_out(list(range(count)), fit, {"initial": [None] * count})
        assert len(fitted) == 20
        assert [error for _, error in found] == [(i, i % 20) for i in range(count)]
        for fold, runs in enumerate(fitted):
            assert runs == {i for i in range(count) if i % 20 != fold}


def test_estimates_of_two_fits_disagree_from_three_deviations_on():
    def fit(value):
        return {"parameters": [dict(name="k", value=value, deviation=3.0, identified=True)]}

    other = {"parameters": [dict(name="k", value=0.0, deviation=4.0, identified=True)]}
    assert validation.disagreements(fit(14.9), other) == []
    assert validation.disagreements(fit(15.1), other) == validation.disagreements(fit(-15.1), other) == ["k"]


def test_values_are_carried_over_to_a_model_that_has_them():
    fitted, extended = model(), candidates.of_library("yaw_bias").add(model())
    fitted.set_value("k", 1.3 * fitted.value("k"))
    extended.set_value("yaw_bias.n0", 2e-4)
    found = candidates.carried_over(fitted, extended)
    assert found.value("k") == fitted.value("k") and found.value("yaw_bias.n0") == 2e-4
    assert extended.value("k") == model().value("k")  # a copy
    back = candidates.carried_over(found, model())
    assert back.effects == [] or "yaw_bias" not in back.effects
    assert back.value("k") == fitted.value("k")


def test_the_wald_ratio_counts_from_where_an_effect_does_nothing():
    craft = candidates.of_library("yaw_bias").add(model())
    craft.set_value("yaw_bias.n0", 3e-4)
    fit = dataclasses.replace(
        GIVEN, model=craft, free=("k", "yaw_bias.n0"), scale=np.array([0.1, 1e-4]),
        information=np.array([[4.0, 1.0], [1.0, 2.0]]),
    )  # fmt: skip
    covariance = np.linalg.inv(fit.information)[1, 1]
    assert fit.ratio_without("yaw_bias") == pytest.approx(3.0**2 / covariance)
    lag = candidates.of_library("motor_lag").add(model())
    (parameter,) = candidates.parameters_of(lag, "motor_lag")
    lag.set_value(parameter["name"], 0.05)
    away = 1 / 0.05 if np.isinf(parameter["neutral"]) else 0.05 - parameter["neutral"]
    one = dataclasses.replace(
        GIVEN, model=lag, free=(parameter["name"],), scale=np.array([0.02]), information=np.array([[5.0]])
    )
    assert one.ratio_without("motor_lag") == pytest.approx(5 * (away / 0.02) ** 2)
    slow = {"name": "tau", "neutral": np.inf}
    assert _from_neutral(slow, types.SimpleNamespace(value=lambda name: 4.0)) == 0.25
