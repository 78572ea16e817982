"""A learned wrench stands in for an effect without a name: simulated, compared, fitted, driven by."""

import itertools

import numpy as np
import pytest
import yaml

import ground
from conftest import MODEL, ROOT, identify
from ground import _core
from ground.analysis import candidates, likelihood

GAINS = ROOT / "cfg" / "gains" / "tiny_whoover.yaml"
PULL = 0.08  # force towards a point, per distance [N/m]
POINT = np.array([0.3, -0.2])  # [m]
EDGE = 2.2  # of what was learned [m]
NODES = np.linspace(-EDGE, EDGE, 12)


def stand_in(scale=1.0):
    """A spring towards a point on the floor, learned where the craft was."""
    centres = np.array(list(itertools.product(NODES, NODES)))
    widths = [0.6, 0.6]
    places = EDGE * np.random.default_rng(1).uniform(-1, 1, (1000, 2))
    bells = _core.bells(["x", "y"], widths, centres, places)
    ridge = 1e-4 * np.eye(len(centres))
    weights = np.linalg.solve(bells.T @ bells + ridge, bells.T @ (-PULL * (places - POINT)))
    term = {
        "arguments": ["x", "y"],
        "widths": widths,
        "frame": "world",
        "centres": centres.tolist(),
        "weights": {"X": weights[:, 0].tolist(), "Y": weights[:, 1].tolist()},
    }
    return {"name": "learned_wrench", "scale": scale, "terms": [term]}


@pytest.fixture(scope="module")
def craft():
    model = ground.Model.load(MODEL)
    return ground.Model(candidates.from_entry(stand_in(), "the stand-in").add(model.core))


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    """The craft with the true spring, as formulas."""
    file = tmp_path_factory.mktemp("spring") / "spring.yaml"
    file.write_text(
        "{name: spring, parameters: {k: {value: %g, unit: N/m}}, frame: world, "
        "expression: {X: '-k*(x - 0.3)', Y: '-k*(y + 0.2)'}}" % PULL
    )
    return ground.Model.load(MODEL).with_effect(file)


@pytest.fixture(scope="module")
def runs(spring):
    """Recordings of the true craft."""
    return [ground.simulate(spring, "prbs", duration=8, seed=seed) for seed in (1, 2)]


def test_it_predicts_as_well_as_the_effect_that_it_stands_for(craft, runs):
    assert max(np.abs(run.eta[:, :2]).max() for run in runs) < EDGE
    found = ground.compare({"without": MODEL, "with": craft}, runs)
    errors = {label: found.pooled[label]["all"]["error"] for label in found.models}
    assert errors["without"] > 4 * found.noise_floor
    assert errors["with"] < 1.1 * found.noise_floor


def test_it_is_simulated_and_fitted_like_any_other(craft, runs):
    own = ground.simulate(craft, "prbs", duration=8, seed=3)
    assert ground.compare(craft, own).pooled
    free = ["learned_wrench.scale", "k"]
    away = craft.with_values({"learned_wrench.scale": 0.7, "k": 0.06})
    found = ground.fit(away, [*runs, own], free=free)
    assert found.model["learned_wrench.scale"] == pytest.approx(1, abs=0.02)
    assert found.model["k"] == pytest.approx(craft["k"], rel=0.01)


def test_the_likelihood_of_poses_finds_its_size(craft):
    times = np.arange(0, 8, 0.01)
    random = np.random.default_rng(1)
    edges = np.arange(0, 8, 1 / 15)
    bits = random.integers(0, 2, (len(edges), 2))
    inputs = np.column_stack([edges, bits, np.ones(len(edges))])
    noise = np.array([3e-4, 3e-4, 5e-3])
    motion = _core.simulate(craft.core, inputs, times, np.zeros(3), np.zeros(3))
    eta = motion["eta"] + noise * random.normal(size=(len(times), 3))
    run = _core.RunData("run", times, eta, motion["nu"], inputs, eta, noise)
    free = ["learned_wrench.scale", "k"]
    start = craft.with_values({"learned_wrench.scale": 0.5}).core
    found = likelihood.Likelihood([run], craft.core, ()).fit(start, free)
    scale = found.parameters[0]
    low, high = scale["ci95"]
    assert low - 0.02 < 1 < high + 0.02 and high - low < 0.2
    assert found.ratio_without("learned_wrench") > 100


def test_controllers_drive_by_it(craft):
    """A predictive controller that knows the pull of the floor follows better than one that does not."""
    truth = craft.with_values({"learned_wrench.scale": 0.05})
    told = dict(truth=truth, end_time=15, settled=8)
    errors = [
        ground.track(model, "circle", controller="ModelPredictive", size=0.5, **told).rms
        for model in (truth, MODEL)
    ]
    assert errors[0] < 0.1 * errors[1]
    slow = ground.track(truth, "circle", gains=GAINS, **told)  # TrajectoryTracking
    assert not slow.stopped and slow.rms < 0.1


def test_it_is_said_to_be_a_stand_in(craft):
    assert "stand-in" in candidates.in_words("learned_wrench", craft.core)
    assert "stand-in" in repr(craft) and "stand-in" in craft.format()
    assert "stand-in" in craft.to_frame().loc["learned_wrench.scale", "meaning"]


def test_add_takes_it_from_a_file(runs, craft, tmp_path):
    file, out = tmp_path / "stand_in.yaml", tmp_path / "with.yaml"
    file.write_text(yaml.safe_dump(stand_in(scale=0.5)))
    bag = tmp_path / "run.bag"
    runs[0].save(bag)
    result = identify("add", file, bag, "--model", MODEL, "-o", out)
    assert result.returncode == 0, result.stderr
    assert "stand-in" in out.read_text()
    saved = ground.Model.load(out)
    assert saved["learned_wrench.scale"] == pytest.approx(1, abs=0.05)
    assert ground.Model.parse(saved.format()).values == saved.values


def test_a_wrong_file_is_refused_in_a_sentence(runs, tmp_path):
    bag, file = tmp_path / "run.bag", tmp_path / "stand_in.yaml"
    runs[0].save(bag)
    for key, value in (("arguments", ["x", "height"]), ("widths", [0.5, 0]), ("centres", [[0, 0]])):
        entry = stand_in()
        entry["terms"][0][key] = value
        file.write_text(yaml.safe_dump(entry))
        result = identify("add", file, bag, "--model", MODEL, "-o", tmp_path / "with.yaml")
        assert result.returncode == 1
        assert result.stderr.count("\n") == 1 and "stand_in.yaml, line " in result.stderr
