"""The search for gains, and its result for the Tiny Whoover."""

import json

import numpy as np
import pytest
import yaml

from conftest import MODEL, ROOT, program, slow

TABLE_4_1 = ROOT / "cfg" / "hovercraft" / "tiny_whoover_4_1.yaml"
GAINS = ROOT / "cfg" / "gains"
DELAYED = ROOT / "test" / "rostest" / "delayed_craft.yaml"
FRESH_SEED = 20261121  # no search has used it
# References of the thesis, and two others that the choice among the found gains used.


@pytest.mark.parametrize("reference", ["circle", "line", "rhodonea"])
def test_the_tuned_gains_are_better_than_those_of_the_thesis(reference):
    """From fresh starts; `make bench-tracking` has more."""
    from ground import _core
    from ground.simulation import gains, tracking

    model = _core.load_model(str(TABLE_4_1))
    worst = {}
    for name in ("thesis_4_11", "thesis_4_12", "tiny_whoover"):
        choice = gains.choice("TrajectoryTracking", str(GAINS / (name + ".yaml")))
        task, starts = tracking.task(reference), tracking.starts(6, FRESH_SEED)
        runs = tracking.many(model, model, choice, task, starts, max_error=np.inf)
        worst[name] = max(run.numbers["rms"] for run in runs)
    factor = 0.1 if reference == "circle" else 1.0
    assert worst["tiny_whoover"] < factor * min(worst["thesis_4_11"], worst["thesis_4_12"])


@slow
def test_a_search_finds_better_gains_and_writes_them(tmp_path):
    out = tmp_path / "gains.yaml"
    search = ["--model", TABLE_4_1, "--evaluations", 50, "--starts", 1, "--test-starts", 4]
    search += ["--references", "circle", "--holdout", "rhodonea", "-o", out]
    result = program("tune", *search, "--json")
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    for row in found["table"]:
        assert row["held_out"] == (row["reference"] == "rhodonea")
        if row["reference"] == "circle":
            medians = {name: q["median"] for name, q in row["rms"].items()}
            assert medians["tuned"] < min(medians["(4.11)"], medians["(4.12)"])
    assert found["candidates"] >= 50
    # track, rosparam load and dynparam load read this file.
    written = yaml.safe_load(out.read_text())
    assert written == pytest.approx(found["gains"], rel=1e-5)
    again = program("track", "--model", TABLE_4_1, "--end-time", 10, "--gains", out, "--json")
    assert json.loads(again.stdout)["gains"] == pytest.approx(written)
    # Existing files are not overwritten.
    refused = program("tune", *search)
    assert refused.returncode == 1 and "exists" in refused.stderr


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--references", "spiral.csv"], "spiral.csv: cannot be read"),
        (["--references", "spiral"], "must be one of circle"),
        (["--references", "circle:sise=2"], "circle does not take 'sise'"),
        (["--references", "sinusoid:petals=2"], "sinusoid:petals=2: reference sinusoid does not"),
        (["--references", "circle:size=big"], "'big' is not a number"),
        (["--controller", "OpenLoopPRBS"], "invalid choice"),
        (["--model", DELAYED], "because it does not use input_delay"),
        (["--evaluations", "0"], "not positive"),
    ],
)
def test_bad_input_is_refused(tmp_path, arguments, message):
    result = program("tune", "--model", MODEL, "-o", tmp_path / "gains.yaml", *arguments)
    assert result.returncode in (1, 2)
    assert message in result.stderr
