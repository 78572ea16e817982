"""identify fit in this process: how its work grows, and parameters that are not identifiable."""
import numpy as np
import pytest
from conftest import MODEL, write_bag


def run_verb(*arguments):
    """Runs a verb of identify in this process; returns its report."""
    from ground import cli, errors

    parsed = cli._parser().parse_args([str(a) for a in arguments] + ["--json"])
    with errors.warnings_as_lines():
        return parsed.run(parsed)


def test_the_work_of_a_fit_grows_with_the_length_of_a_run_not_with_its_square(
    tmp_path, monkeypatch
):
    from ground.recordings import windows

    problem, handled = windows.problem, []

    def counted(runs, chosen, *target):
        handled.append(len(chosen))
        return problem(runs, chosen, *target)

    monkeypatch.setattr(windows, "problem", counted)
    work, blocks = {}, {}
    for duration in (30, 120):
        bag = write_bag(tmp_path / ("run%d.bag" % duration), duration=duration, seed=3)
        handled.clear()
        out = tmp_path / ("f%d.yaml" % duration)
        report = run_verb("fit", bag, "--model", MODEL, "-o", out, "--block", 2)
        work[duration], blocks[duration] = sum(handled), report["error"]["blocks"]
    assert work[120] < 1.3 * 4 * work[30], work
    assert [blocks[d]["count"] for d in (30, 120)] == [15, 60]
    assert [blocks[d]["folds"] for d in (30, 120)] == [10, 10]


def test_blocks_held_out_in_parts_have_the_error_of_blocks_held_out_one_by_one(tmp_path):
    from ground import _core
    from ground.analysis import study, validation
    from ground.recordings import quality, readers, windows

    lagging = tmp_path / "lag.yaml"
    lagging.write_text(
        MODEL.read_text().replace("effects: []", "effects: [{name: motor_lag, tau: 0.06}]")
    )
    bag = write_bag(tmp_path / "run.bag", duration=60, seed=3, model=lagging)
    model = _core.load_model(str(MODEL))
    runs = [quality.repaired(readers.read(str(bag))).data(model)]

    def fit(cut, initial):
        near = {"near": True, "initial": initial} if initial else {}
        return windows.problem(runs, cut).fit(model, list(study.NOMINAL), **near)

    def whole(cut, initial):
        return windows.problem(runs, cut).fit(model, list(study.NOMINAL))

    parts = validation.leave_blocks_out(runs, [model], fit, block=3)
    single = validation.leave_blocks_out(runs, [model], whole, block=3, most=1000)
    assert (parts["folds"], single["folds"]) == (10, 20)
    assert parts["heldout"] == pytest.approx(single["heldout"], rel=0.01)


def constant(level, nu=(0, 0, 0), seed=1):
    """A change of write_bag: both commands constant at one level."""
    import numpy as np
    from ground import _core

    def change(times, eta, inputs):
        inputs = inputs.copy()
        inputs[:, 1:3] = level
        model = _core.load_model(str(MODEL))
        run = _core.simulate(model, inputs, times, np.zeros(3), np.array(nu, float))
        noise = np.random.default_rng(seed).normal(0, [3e-4, 3e-4, 5e-3], (len(times), 3))
        eta = run["eta"] + noise
        eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
        return times, eta, inputs

    return change


def test_parameters_not_identifiable_with_constant_commands_keep_their_start(tmp_path):
    from ground import _core

    start = _core.load_model(str(MODEL))
    bag = write_bag(tmp_path / "run.bag", change=constant(0.5, seed=5))
    out = tmp_path / "f.yaml"
    report = run_verb("fit", bag, "--model", MODEL, "-o", out)
    fitted = _core.load_model(str(out))
    for name in ("I_z", "N_r"):
        assert not report["parameters"][name]["identified"]
        assert fitted.value(name) == start.value(name), name
    assert report["parameters"]["k"]["identified"] and report["parameters"]["X_u"]["identified"]
    assert fitted.value("k") == pytest.approx(0.062, rel=0.1)
    assert fitted.provenance.not_identified == ["I_z", "N_r"]
    assert "not_identified: [I_z, N_r]  # kept at their start values" in out.read_text()


def test_if_only_a_ratio_is_identifiable_one_parameter_keeps_its_start(tmp_path):
    from ground import _core

    other = tmp_path / "other.yaml"
    other.write_text(MODEL.read_text().replace("N_r: 4.62e-5", "N_r: 9e-5"))
    spin = write_bag(tmp_path / "run.bag", change=constant(0.0, (0.5, 0.2, 6)))
    report = run_verb("fit", spin, "--model", other, "-o", tmp_path / "f.yaml")
    fitted, start = _core.load_model(str(tmp_path / "f.yaml")), _core.load_model(str(other))
    assert fitted.provenance.not_identified == ["I_z", "N_r", "k"]
    assert fitted.value("k") == start.value("k")
    assert start.value("N_r") == fitted.value("N_r") or start.value("I_z") == fitted.value("I_z")
    assert fitted.value("N_r") / fitted.value("I_z") == pytest.approx(4.62e-5 / 8.8e-5, rel=0.03)
    assert not report["parameters"]["I_z"]["identified"]


def swapped(times, eta, inputs):
    late = np.arange(len(times))
    late[[100, 101]] = 101, 100
    return times[late], eta[late], inputs


def test_fit_and_add_warn_of_reversed_stamps(tmp_path, capsys):
    bag = write_bag(tmp_path / "run.bag", change=swapped)
    run_verb("fit", bag, "--model", MODEL, "-o", tmp_path / "f.yaml")
    assert "warning: run: stamps out of order, sorted: 1" in capsys.readouterr().err
    run_verb("add", "motor_lag", bag, "--model", MODEL, "-o", tmp_path / "g.yaml")
    assert "warning: run: stamps out of order, sorted: 1" in capsys.readouterr().err
