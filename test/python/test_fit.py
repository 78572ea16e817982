"""identify fit from inside: what its work grows with, and what it does with what is not identifiable."""
import pytest
from conftest import MODEL, write_bag


def run_verb(*arguments):
    """What a verb of identify returns, run in this process."""
    from ground import cli

    parsed = cli._parser().parse_args([str(a) for a in arguments] + ["--json"])
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
    from ground.recordings import quality, recording, windows

    lagging = tmp_path / "lag.yaml"
    lagging.write_text(
        MODEL.read_text().replace("effects: []", "effects: [{name: motor_lag, tau: 0.06}]")
    )
    bag = write_bag(tmp_path / "run.bag", duration=60, seed=3, model=lagging)
    model = _core.load_model(str(MODEL))
    runs = [quality.Run(recording.read_bag(str(bag))).data(model)]

    def fit(cut, initial):
        near = {"near": True, "initial": initial} if initial else {}
        return windows.problem(runs, cut).fit(model, list(study.FIVE), **near)

    def whole(cut, initial):
        return windows.problem(runs, cut).fit(model, list(study.FIVE))

    parts = validation.leave_blocks_out(runs, [model], fit, block=3)
    single = validation.leave_blocks_out(runs, [model], whole, block=3, most=1000)
    assert (parts["folds"], single["folds"]) == (10, 20)
    assert parts["heldout"] == pytest.approx(single["heldout"], rel=0.01)
