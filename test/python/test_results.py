"""Results of a script: figures one by one, files that are read again, copies in other processes."""

import pickle

import numpy as np
import pandas
import pytest

import ground
from conftest import ROOT
from ground.simulation.simulated_run import SimulatedRun


@pytest.fixture(scope="module")
def runs(craft):
    truth = craft.with_effect("yaw_bias", n0=2e-5)
    return [ground.simulate(truth, duration=8, seed=s, name="run %d" % s) for s in (1, 2)]


@pytest.fixture(scope="module")
def fitted(craft, runs):
    return ground.fit(craft, runs, free=["k", "N_r"])


@pytest.fixture(scope="module")
def compared(craft, fitted, runs):
    return ground.compare({"given": craft, "fitted": fitted.model}, runs)


@pytest.fixture(scope="module")
def tracked(craft):
    return ground.track(craft, "circle", end_time=12, settled=5)


@pytest.fixture(scope="module")
def discovered(craft, tmp_path_factory):
    folder = tmp_path_factory.mktemp("discovered")
    truth = craft.with_effect("yaw_bias", n0=1e-4)
    return ground.discover(craft, truth, folder, budget=30, track=False)


def all_of(made):
    """Figures by name; one alone as well."""
    return made if isinstance(made, ground.Figures) else {"": made}


def has_data(figure):
    return len(figure.data) > 0 and "[" in str(figure.layout) and figure.layout.meta


def test_a_fit_has_the_numbers_that_a_statistician_wants(fitted):
    summary, interval = fitted.to_frame(), fitted.conf_int()
    for name, p in fitted.parameters.items():
        assert np.allclose(interval.loc[name], p.ci95)
        assert summary.loc[name, "std_error"] == p.deviation
        assert fitted.covariance.loc[name, name] == pytest.approx(p.deviation**2)
    widths = [float(np.diff(fitted.conf_int(level).loc["k"])[0]) for level in (0.5, 0.9, 0.99)]
    assert widths == sorted(widths)
    assert widths[2] / widths[0] > 3.82  # of a normal variable; fewer data have longer tails
    correlation = fitted.correlation.to_numpy()
    assert np.allclose(correlation, correlation.T) and (np.abs(correlation) <= 1 + 1e-9).all()
    residuals = fitted.residuals
    assert set(residuals.run) == {"run 1", "run 2"} and residuals.attrs["units"]["r"] == "rad/s"
    assert residuals.u.abs().max() < 1
    with pytest.raises(ground.GroundError, match="below 1"):
        fitted.conf_int(95)


def test_an_interval_of_an_inertia_is_one_of_its_reciprocal(craft, runs):
    found = ground.fit(craft, runs, free=["I_z"])
    low, high = found.conf_int(0.5).loc["I_z"]
    assert 1 / low + 1 / high == pytest.approx(2 / found.parameters["I_z"].value)
    assert np.allclose(found.conf_int(0.95).loc["I_z"], found.parameters["I_z"].ci95)


def test_every_result_draws_its_figures_one_by_one(runs, fitted, compared, diagnosed, tracked, discovered):
    for result, names in (
        (runs[0], [""]),
        (fitted.predict(runs[0]), ["motion", "residuals"]),
        (fitted, ["parameters", "correlation", "motion run 1", "motion run 2"]),
        (compared, ["errors", "motion run 1", "wrench run 2", "residuals run 2"]),
        (diagnosed, ["errors", "motion run", "wrench run", "residuals run"]),
        (tracked, [""]),
        (discovered, ["errors", "flight 1"]),
    ):
        made = all_of(result.plot())
        assert set(names) <= set(made), type(result)
        for name in names:
            assert has_data(made[name]), (type(result), name)
        assert has_data(result.plot(names[-1] or list(made)[0])), type(result)
    assert has_data(diagnosed.plot("motion"))
    with pytest.raises(ground.GroundError, match="there are errors, motion run 1"):
        compared.plot("motion")
    with pytest.raises(ground.GroundError, match="results and recordings, not float"):
        ground.plot(3.0)
    page = compared.plot()._repr_html_()
    assert page.count("<h4>") == len(compared.plot()) and "<html" not in page.split("plotly.js")[0]


def test_results_survive_their_folder(craft, runs, fitted, compared, diagnosed, tracked, tmp_path):
    compared.save(tmp_path / "compared", page=False)
    diagnosed.save(tmp_path / "diagnosed")
    fitted.save(tmp_path / "fitted.yaml")
    tracked.save(tmp_path / "tracked.json")
    runs[0].save(tmp_path / "run.bag")
    again = ground.load(tmp_path / "compared")
    pandas.testing.assert_frame_equal(again.to_frame(), compared.to_frame())
    assert str(again) == str(compared) and again.best == compared.best and again.models == compared.models
    assert has_data(again.plot())
    again = ground.load(str(tmp_path / "diagnosed"))
    for name in ("verdict", "effects", "error", "noise_floor", "parameters", "improved"):
        assert getattr(again, name) == getattr(diagnosed, name), name
    assert str(again) == str(diagnosed) and has_data(again.plot())
    pandas.testing.assert_frame_equal(again.to_frame(), diagnosed.to_frame())
    again = ground.load(tmp_path / "tracked.json")
    assert str(again) == str(tracked) and has_data(again.plot())
    pandas.testing.assert_frame_equal(again.to_frame(), tracked.to_frame())
    model = ground.load(tmp_path / "fitted.yaml")
    assert model == fitted.model and model.fitted.ci95["k"] == fitted.parameters["k"].ci95
    assert craft.fitted is None and model.with_values({"k": 0.1}).fitted is None
    assert ground.load(tmp_path / "run.bag").identity == runs[0].identity
    assert ground.load(ROOT / "cfg" / "room" / "room_4x4.yaml").margin > 0
    for loaded in (ground.load(tmp_path / "compared"), ground.load(tmp_path / "diagnosed")):
        with pytest.raises(ground.GroundError, match="was loaded"):
            loaded.save(tmp_path / "other")


def test_a_discovery_is_read_from_its_folder(discovered):
    again = ground.load(discovered.page.rsplit("/", 1)[0])
    for name in ("verdict", "effects", "groups", "sure", "confirmed", "seconds", "model", "page"):
        assert getattr(again, name) == getattr(discovered, name), name
    assert str(again) == str(discovered)
    pandas.testing.assert_frame_equal(again.to_frame(), discovered.to_frame())
    with pytest.raises(ground.GroundError, match="not a discovery"):
        type(again).load("cfg")
    assert set(pickle.loads(pickle.dumps(discovered)).plot()) == set(discovered.plot())


@pytest.mark.parametrize(
    "name,text,words",
    [
        ("nothing", None, "no such file"),
        ("diagnosis.json", "{", "not JSON"),
        ("compare.json", "{}", "schema"),
        ("other.json", "[]", "not a result file"),
        ("other.json", "{}", "not a result file"),
        ("model.yaml", "a: 1", "model.yaml"),
        ("notes.txt", "hello", "no row contains numbers"),
    ],
)
def test_what_cannot_be_loaded_is_named(name, text, words, tmp_path):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ground.GroundError, match=words):
        ground.load(tmp_path / name)


def test_results_are_copied_to_other_processes(craft, runs, fitted, compared, diagnosed, tracked, tmp_path):
    for result in (craft, runs[0], fitted, compared, diagnosed, tracked, fitted.predict(runs[0])):
        again = pickle.loads(pickle.dumps(result))
        assert type(again) is type(result) and repr(again) == repr(result)
    again = pickle.loads(pickle.dumps(diagnosed))
    again.save(tmp_path / "copy")
    assert (tmp_path / "copy" / "report.html").stat().st_size > 1e5
    assert isinstance(pickle.loads(pickle.dumps(runs[0])), SimulatedRun)
