"""How much of a model's error any function of what was recorded could still explain."""

import math

import numpy as np
import pytest
import yaml

from conftest import MODEL, ROOT, identify, write_bag
from conftest import nominal as craft
from ground import _core
from ground.analysis import (
    channels,
    dictionary,
    naming,
    samples,
    window_error,
    windows,
)
from ground.analysis.agreement import agreement
from ground.analysis.ceiling import ceiling
from ground.analysis.formula_words import FormulaTerm
from ground.analysis.innovations import Innovations
from ground.analysis.likelihood import Likelihood
from ground.analysis.regression import Regression
from ground.analysis.window_error import squared_errors
from ground.effect_library import candidates
from ground.poses import angles, repair

NOISE = np.array([3e-4, 3e-4, 5e-3])  # [m], [m], [rad]
TABLE = ROOT / "cfg" / "craft" / "air_table.yaml"
STEP = 0.002  # of the integration [s]
FREE = ("I_z", "X_u", "Y_v", "N_r", "k")


# --- A craft of its own: neither equations nor integrator are the project's


def rates(body, state, fixed, missing):
    _, _, psi, u, v, r = state
    X, Y, N = (a + b for a, b in zip(fixed, missing))
    c, s = math.cos(psi), math.sin(psi)
    return (
        c * u - s * v, s * u + c * v, r,
        (X - body["X_u"] * u) / body["m"] + v * r, (Y - body["Y_v"] * v) / body["m"] - u * r,
        (N - body["N_r"] * r) / body["I_z"],
    )  # fmt: skip


def flown(
    seed,
    missing=lambda state: (0.0, 0.0, 0.0),
    push=0.0,
    duration=8.0,
    lost=(),
    burst=None,
    levels=((0, 1), (0, 0.9)),
):
    """A run of a craft on which `missing` acts, beside a random push, relative to full thrust, and a burst of
    it (begin, end, size); and the missing wrench at its poses. lost: span of time without poses; levels:
    two of each thruster, between which it switches at random."""
    model, random = craft(), np.random.default_rng(seed)
    body = {name: model.value(name) for name in ("m", "l", *FREE)}
    steps = int(round(duration / STEP))
    switched = random.integers(0, 2, (int(10 * duration) + 1, 2))
    commands = np.where(switched, *[[pair[i] for pair in levels] for i in (1, 0)])
    full = 2 * body["k"] * np.array([1, 1, body["l"]])
    stay = math.exp(-STEP / 0.2)
    drawn = push * full * math.sqrt(1 - stay**2) * random.normal(size=(steps, 3))
    slow, state = push * full * random.normal(size=3), (0.0, 0.0, 0.3, 0.2, 0.0, 0.5)
    poses, acted = [], []
    for i in range(steps):
        if i % 5 == 0:
            poses.append(state[:3])
            acted.append(missing(state))
        left, right = body["k"] * commands[i * 10 // int(round(1 / STEP))]
        fixed = [left + right + slow[0], slow[1], body["l"] * (left - right) + slow[2]]
        if burst and burst[0] <= i * STEP < burst[1]:
            fixed[1] += burst[2] * full[1]
        slow = stay * slow + drawn[i]

        middle = [x + STEP / 2 * d for x, d in zip(state, rates(body, state, fixed, missing(state)))]
        slope = rates(body, middle, fixed, missing(middle))  # the rule of the midpoint
        state = tuple(x + STEP * d for x, d in zip(state, slope))
    times = np.arange(len(poses)) * 5 * STEP
    seen = np.array(poses) + random.normal(0, NOISE, (len(poses), 3))
    kept = (times < lost[0]) | (times > lost[1]) if lost else np.ones(len(times), bool)
    inputs = np.column_stack([np.arange(len(commands)) / 10, commands, np.ones(len(commands))])
    times, seen, acted = times[kept], seen[kept], np.array(acted)[kept]
    smooth = repair.smooth(times, seen, (NOISE[0], NOISE[2]), _core.RunScales())
    run = _core.RunData("run%d" % seed, times, smooth["eta"], smooth["nu"], inputs, seen, NOISE)
    return run, acted


SIZE = 1.5e-4  # of the compass [N m]


def compass(state):
    return 0.0, 0.0, SIZE * math.sin(state[2] + 0.4)


def measured(runs):
    """The likelihood of runs, the fit of the nominal model, windows, and their Ceiling."""
    likelihood = Likelihood(runs, craft())
    fit = likelihood.fit(craft(), FREE)
    cut = windows.cut(runs)
    return likelihood, fit, cut, ceiling(likelihood, fit, runs, cut, fit.model)


@pytest.fixture(scope="module")
def turning():
    """Runs of a craft with a compass in slight the missing wrenches, and what is measured of them."""
    made = [flown(seed, compass, push=0.01) for seed in (1, 2, 3)]
    return [run for run, _ in made], [acted for _, acted in made], measured([run for run, _ in made])


@pytest.fixture(scope="module")
def pushed():
    """Runs of a craft that misses nothing, in and what is measured of them."""
    runs = [flown(seed, push=0.02)[0] for seed in (4, 5, 6)]
    return runs, measured(runs)


def test_what_depends_on_the_heading_is_learnable_in_its_true_share(turning):
    runs, acted, (_, fit, cut, left) = turning
    before = squared_errors(runs, cut, fit.model).sum()
    truth = 1 - squared_errors(runs, cut, craft(), acted).sum() / before
    assert truth > 0.5 and left.said and not left.of_the_past
    assert next(iter(left.arguments)) == "heading"
    assert left.left.value == pytest.approx(truth, abs=0.05)
    assert left.left.low - 0.02 < truth < left.left.high + 0.02


def test_a_moment_by_heading_gets_its_name_and_size(turning):
    _, _, (likelihood, fit, _, left) = turning
    formula = naming.formula(likelihood, fit, left.found.regression)
    assert formula.means.startswith("a moment to the right that depends on the heading (= ")
    assert set(formula.entry["expression"]) == {"N"}
    (size,) = (p["value"] for p in formula.entry["parameters"].values() if p["unit"] == "N m")
    assert abs(size) == pytest.approx(SIZE, rel=0.1)
    assert "0.15" in formula.means and "mN m" in formula.means
    entry = yaml.safe_load(yaml.safe_dump(formula.entry))  # as a file has it
    assert candidates.from_entry(entry, "proposal.yaml", craft()).name == formula.entry["name"]


def test_nothing_is_said_of_a_craft_that_is_only_pushed(pushed):
    runs, (likelihood, fit, cut, left) = pushed
    assert not left.said and left.learnable.value < 0.02
    assert 0 <= left.bound <= 1
    assert agreement(runs, cut, likelihood, fit, 1.0).holds


def test_one_run_is_enough_also_where_poses_are_missing_for_a_time():
    _, _, _, left = measured([flown(7, compass, push=0.005, duration=14.0, lost=(3.0, 3.4))[0]])
    assert left.said and next(iter(left.arguments)) == "heading"


@pytest.mark.parametrize("strength, duration", [(0.0, 8.0), (0.02, 8.0), (1.0, 1.0)])
def test_a_craft_that_hardly_moves_gets_an_answer_or_a_reason(tmp_path, strength, duration):
    bags = [
        write_bag(tmp_path / ("%d.bag" % seed), seed=seed, strength=strength, duration=duration)
        for seed in (1, 2)
    ]
    result = identify(
        "diagnose", *bags, "--model", MODEL, "-o", tmp_path / "out", "--only", "floor_tilt", "wind"
    )
    assert "Traceback" not in result.stderr
    if result.returncode:
        assert len(result.stderr.strip().splitlines()) == 1
    else:
        assert "nan" not in result.stdout


# --- The regression


def regression_of(likelihood, fit, formulas):
    """A Regression on features by channel and formula."""
    features = [
        dictionary.Feature(channels.Channel({c: "%s*" + text for c, text in parts.items()}, ""), (), "test")
        for parts in formulas
    ]
    sampled = [samples.of_run(likelihood, fit, i) for i in range(len(likelihood.runs))]
    return Regression(Innovations(likelihood, fit), features, sampled, [1] * len(features))


def test_the_wrench_of_a_run_is_predicted_from_the_others(turning):
    """A run with another effect changes the predictions of the other runs, and not its own."""
    runs, _, (likelihood, fit, _, _) = turning
    odd, _ = flown(3, lambda state: tuple(-part for part in compass(state)), push=0.01)
    sizes = []
    for last in (runs[2], odd):
        some = [*runs[:2], last]
        likelihood = Likelihood(some, craft())
        regression = regression_of(likelihood, fit, [{"N": "sin(psi+0.4)"}])
        predicted = regression.predicted([regression.test(np.array([0]), regression.alone)])
        sized = []
        for i, wrench in enumerate(predicted):
            shape = np.sin(samples.of_run(likelihood, fit, i).values["psi"] + 0.4)
            sized.append(float(wrench[:, 2] @ shape / (shape @ shape)))
        sizes.append(sized)
    first, other = np.array(sizes)
    assert other[2] == pytest.approx(first[2], rel=0.05)
    assert (np.abs(other[:2] - first[:2]) > 0.5 * np.abs(first[:2])).all()


def test_a_part_of_a_run_holds_what_acts_in_its_time_also_where_poses_are_lost_unevenly():
    run, _ = flown(7, duration=12.0)
    times = np.array(run.times)
    kept = (times > 6) | (np.mod(times, 0.5) > 0.2)
    of_kept = {name: np.array(getattr(run, name))[kept] for name in ("times", "eta", "nu", "poses")}
    likelihood = Likelihood([run.replaced(**of_kept)], craft())
    fit = likelihood.fit(craft(), FREE)
    regression = regression_of(likelihood, fit, [{"N": "sin(psi)"}])
    for (before, _), (rows, span) in zip(regression.parts, regression.parts[1:]):
        wrench = np.zeros((len(likelihood.runs[0].times), 3, 1))
        wrench[span, 2] = 1e-3
        acts = np.flatnonzero(np.abs(regression.innovations.responses([wrench])[:, 0]) > 0)
        assert before.stop <= acts.min() < rows.start + 10


# --- The dictionary


def states_of(memory, text):
    """The states of a formula as an effect file lists them."""
    known = memory.of(text)
    values = {name: repr(value) for name, (value, _) in known.times.items()}
    return {"states": {s: rate.format(**values) for s, rate in known.rates.items()}} if known.rates else {}


def path_of(model, seed=3, duration=0.6):
    """Samples along a motion under a model, every 2 ms, and the mean wrench between them."""
    random, count = np.random.default_rng(seed), len(samples.inputs(model))
    times = np.arange(int(duration / STEP)) * STEP
    edges = np.arange(0, duration, 0.1)
    lift = 0.6 + 0.4 * random.random(len(edges))
    rows = np.column_stack([edges, random.random((len(edges), count)), lift])
    at = (np.arange(len(times)) * 20) // 1000
    start = np.array([0.3, -0.2, 0.5]), np.zeros(3)  # at rest, as states begin at zero
    motion = _core.simulate(model, rows, times, *start)
    eta, nu = np.array(motion["eta"]), np.array(motion["nu"])
    names = samples.inputs(model)
    values = {"x": eta[:, 0], "y": eta[:, 1], "psi": angles.wrap(eta[:, 2]), "t": times}
    values.update(zip("uvr", nu.T), lift=rows[at, -1], **dict(zip(names, rows[at, 1:-1].T)))
    m, size = model.value("m"), np.array([model.value(n) for n in ("X_u", "Y_v", "N_r")])
    inertia = np.array([m, m, model.value("I_z")])
    mean = (nu[1:] + nu[:-1]) / 2
    turning = m * mean[:, [2]] * np.column_stack([-mean[:, 1], mean[:, 0], np.zeros(len(mean))])
    thrust = model.forces(rows[at[:-1], 1:-1]) * model.value("k") * [1, 1, model.value("l")]
    wrench = inertia * np.diff(nu, axis=0) / STEP + turning + size * mean - thrust
    return samples.samples_of(model, {n: np.array(v) for n, v in values.items()}, times, 1.0), wrench


SCALES = samples.Scales((0.1, 0.2), 1.5, 0.4, 1.5, 8.0, 1.0)


@pytest.mark.parametrize("path", [MODEL, TABLE], ids=["pair", "eight jets"])
def test_a_feature_is_in_the_model_what_it_is_in_the_dictionary(path):
    """As an effect file its formula gives the wrench that the regression has, its states included."""
    model = _core.load_model(str(path))
    features = dictionary.dictionary(model, SCALES)
    kinds = {}
    for feature in features:  # the last one of each family that acts on the same number of channels
        kinds[feature.family, len(feature.parts)] = feature
    full = 2 * model.value("k") * np.array([1, 1, model.value("l")])
    memory = samples.memory(model, SCALES.time_scale)
    usual = dictionary.wrenches(list(kinds.values()), model, path_of(model)[0])
    sizes = np.abs(usual / full[:, None]).max(axis=(0, 1))
    for feature, largest in zip(kinds.values(), sizes):
        weight = float(0.1 / max(largest, 1e-9))
        entry = {"name": "one", **states_of(memory, " ".join(feature.parts.values()))}
        entry["expression"] = {c: "w*(%s)" % f for c, f in feature.parts.items()}
        unit = feature.weight_unit
        entry["parameters"] = {"w": {"value": weight, "unit": unit, "neutral": 0.0}}
        extended = candidates.from_entry(entry, "one.yaml", model).add(model)
        extended.set_value("one.w", weight)
        moved, wrench = path_of(extended)
        expected = weight * dictionary.wrenches([feature], model, moved)[:, :, 0]
        expected = (expected[1:] + expected[:-1]) / 2
        held = np.ones(len(wrench), bool)
        held[49::50] = False  # where commands switch
        off = np.sqrt((((wrench - expected) / full)[held] ** 2).mean())
        size = np.sqrt(((expected / full) ** 2).mean())
        assert off < 0.05 * size + 1e-5, (feature.family, feature.parts, off / size)


def exponents(unit):
    """Powers of length and time in a unit such as m/s*m^2; angles have none."""
    powers = {"m": 0, "s": 0, "rad": 0}
    for product in unit.split("*"):
        over, _, under = product.partition("/")
        for part, sign in ((over, 1), (under, -1)):
            if part not in ("", "-"):
                name, _, power = part.partition("^")
                powers[name] += sign * int(power or 1)
    return powers["m"], powers["s"]


@pytest.mark.parametrize("length, time", [(3.0, 1.0), (1.0, 5.0)])
@pytest.mark.parametrize("path", [MODEL, TABLE], ids=["pair", "eight jets"])
def test_formulas_have_their_units(path, length, time):
    """In another unit of length or of time, the value of a formula is another as its unit says."""
    model = _core.load_model(str(path))
    sampled, _ = path_of(model)
    values = dict(sampled.values)
    for name, factor in (
        ("x", length), ("y", length), ("u", length / time), ("v", length / time),
        ("r", 1 / time), ("t", time),
    ):  # fmt: skip
        values[name] = values[name] * factor
    s = SCALES
    scales = samples.Scales(
        (s.centre[0] * length, s.centre[1] * length), s.extent * length, s.speed * length / time,
        s.turn / time, s.duration * time, s.time_scale * time,
    )  # fmt: skip
    known, others = (dictionary.dictionary(model, of) for of in (s, scales))
    here = dictionary.wrenches(known, model, sampled).transpose(2, 0, 1)
    other = samples.samples_of(model, values, time * sampled.times, scales.time_scale)
    there = dictionary.wrenches(others, model, other).transpose(2, 0, 1)
    for one, first, second in zip(known, here, there):
        of_length, of_time = exponents(one.unit)
        factor = length**of_length * time**of_time
        assert np.allclose(second, first * factor, rtol=0.02, atol=0.01 * np.abs(first).max() * factor), (
            one.family, one.parts, one.unit,
        )  # fmt: skip


# --- Whether what is left is the random push


def test_recordings_made_by_the_model_agree_with_it_and_a_burst_does_not(pushed):
    runs, (likelihood, fit, cut, _) = pushed
    random = np.random.default_rng(99)
    made = []
    for i, run in enumerate(runs):
        wrench = window_error.pushes(run, fit.levels, random)[0] + fit.trims[i, :3]
        made.append(window_error.recorded(run, fit.model, random, wrench, fit.trims[i, 3]))
    assert agreement(made, cut, Likelihood(made, craft()), fit, 1.0).holds
    odd = [flown(seed, push=0.005, burst=(2.0 + seed, 2.3 + seed, 0.4))[0] for seed in (1, 2, 3)]
    likelihood = Likelihood(odd, craft())
    found = agreement(odd, windows.cut(odd), likelihood, likelihood.fit(craft(), FREE), 1.0)
    assert not found.holds and found.error.noise < found.error.measured


def test_a_formula_has_no_more_states_than_an_effect_can_hold():
    def piece(number, *states):
        return FormulaTerm(number, {}, {}, "", dict.fromkeys(states, ""), ())

    kept, shared, more, none = piece(1, *"abcdef"), piece(2, *"fgh"), piece(3, "i"), piece(4)
    assert naming.with_room_for_states([kept], [shared, more, none]) == [kept, shared, none]
