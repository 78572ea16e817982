"""A load of known mass and place: then motion identifies the mass itself, not only ratios."""

import numpy as np
import pytest

import ground
from conftest import MODEL
from ground import _core
from ground.reading import mapping

LOAD = (0.025, (0.012, -0.006), 4e-6)  # [kg], [m], [kg m^2]


def recorded(name, seed, load=None, seconds=20):
    """A run of the true craft, with a load or without."""
    random = np.random.default_rng(seed)
    at = np.arange(0, seconds, 0.25)
    levels = random.integers(0, 2, (len(at), 2)) * 0.6
    commands = np.column_stack([levels, np.ones(len(at))])
    times = np.arange(0.05, seconds, 0.01)
    core = ground.Model.load(MODEL).core
    payload = _core.Payload(*load) if load else _core.Payload()
    rows = np.column_stack([at, commands])
    eta = _core.simulate(core, rows, times, np.zeros(3), np.zeros(3), payload=payload)["eta"]
    poses = eta + random.normal(size=eta.shape) * (3e-4, 3e-4, 3e-3)
    run = ground.Recording.from_arrays(times, poses, commands, at, name=name)
    return run.with_payload(*load) if load else run


@pytest.fixture(scope="module")
def runs():
    return [recorded("bare", 1), recorded("loaded", 2, LOAD)]


def guessed():
    """The craft with a mass, an inertia and a thrust that are 25% off, at the same ratios."""
    true = ground.Model.load(MODEL)
    return true, true.with_values(
        {name: 0.75 * true[name] for name in ("m", "I_z", "k", "X_u", "Y_v", "N_r")}
    )


def test_two_masses_identify_mass_inertia_and_thrust(runs):
    true, guess = guessed()
    found = ground.fit(guess, runs)
    assert list(found.parameters)[0] == "m"
    for name in ("m", "I_z", "k"):
        low, high = found.parameters[name].ci95
        assert low < true[name] < high
        assert high - low < 0.2 * true[name], name
    named = ground.fit(guess, runs, free=["I_z", "X_u", "Y_v", "N_r", "k"])  # what was asked for, no more
    assert list(named.parameters) == ["I_z", "X_u", "Y_v", "N_r", "k"]
    told = " ".join(found.remarks)
    assert "loaded: 0.025 kg at (0.012, -0.006) m" in told and "not only ratios" in told
    assert {run.run for run in found.runs} == {"bare", "loaded"}


def test_one_mass_identifies_ratios_only(runs):
    _, guess = guessed()
    bare = [runs[0], recorded("bare 2", 3)]
    with pytest.raises(ground.GroundError, match="k/m.*same mass.*payload"):
        ground.fit(guess, bare, free=["m", "k", "I_z", "X_u", "Y_v", "N_r"])
    found = ground.fit(guess, bare)
    assert "m" not in found.parameters
    assert found.model["k"] / found.model["m"] == pytest.approx(0.062 / 0.0583, rel=0.02)


def test_a_forgotten_load_makes_predictions_worse(runs):
    from dataclasses import replace

    true, _ = guessed()
    forgotten = replace(runs[1], payload=_core.Payload())
    told = ground.predict(true, runs[1]).position_mm
    assert ground.predict(true, forgotten).position_mm > 2 * told


def write(folder, text):
    path = folder / "mapping.yaml"
    path.write_text("schema: ground/mapping/1\n" + text)
    return str(path)


def test_a_mapping_says_which_runs_carried_what(tmp_path):
    given = mapping.load(write(tmp_path, "payload:\n  - {runs: 'loaded*', mass: 0.5, place: [0.1, 0]}\n"))
    from ground.reading.payloads import payload_of

    loaded, bare = payload_of("loaded_3", given.loads), payload_of("run_1", given.loads)
    assert (loaded.mass, list(loaded.place), loaded.inertia) == (0.5, [0.1, 0], 0)
    assert bare.empty()


@pytest.mark.parametrize(
    "entry, named",
    [
        ("{mass: -1, place: [0, 0]}", "payload.0.mass"),
        ("{mass: 1}", "payload.0"),
        ("{mass: 1, place: [0]}", "two numbers"),
        ("{mass: 1, place: [0, 0], colour: red}", "payload.0"),
    ],
)
def test_a_wrong_payload_is_refused(tmp_path, entry, named):
    with pytest.raises(ground.GroundError, match=named):
        mapping.load(write(tmp_path, "payload: [%s]\n" % entry))


def test_two_payloads_of_one_run_are_refused(tmp_path):
    from ground.reading.payloads import payload_of

    text = "payload:\n  - {mass: 1, place: [0, 0]}\n  - {runs: 'a*', mass: 2, place: [0, 0]}\n"
    given = mapping.load(write(tmp_path, text))
    with pytest.raises(ground.GroundError, match="several payloads"):
        payload_of("a1", given.loads)
