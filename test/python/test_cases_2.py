"""Recordings after public reports that were read wrongly are read as they were made, or refused."""

import json

import pytest

from conftest import ROOT, succeeds

CASES = ROOT.parent / "shared" / "data" / "cases_2"
# Of the simulated craft, and how far from them an estimate may be: shares of them, N s/m for X_u
TRUTH = {"k": (0.062, 0.02), "I_z": (8.8e-5, 0.03), "Y_v": (0.0271, 0.04), "N_r": (4.62e-5, 0.15)}
X_U = 0.0055, 0.002


@pytest.fixture
def case(request):
    """The folder of a case."""
    if not (CASES / request.param).is_dir():
        pytest.skip("the recordings of shared/data/cases_2 are missing beside the workspace")
    return CASES / request.param


def lines_of(verb, *arguments):
    result = succeeds(verb, *arguments)
    return result.stdout, result.stderr


def fitted(path, options, folder):
    """Results of a fit to a recording, by parameter."""
    options = (*options, "--model", CASES / "start.yaml", "-o", folder / "fitted.yaml", "--json", "--force")
    text, said = lines_of("fit", path, *options)
    return json.loads(text)["parameters"], said


def is_right(found):
    return abs(found["X_u"]["value"] - X_U[0]) < X_U[1] and all(
        abs(found[name]["value"] - value) < share * value for name, (value, share) in TRUTH.items()
    )


@pytest.mark.parametrize("case", ["wpilog_rows"], indirect=True)
@pytest.mark.parametrize("name", ["table.csv", "list.csv"])
def test_a_pose_whose_numbers_stand_in_rows_of_their_own_is_one(case, name, tmp_path):
    lines_of("info", case / name, "--write-mapping", tmp_path / "draft.yaml")
    for mapping in (case / "m.yaml", tmp_path / "draft.yaml"):
        text, _ = lines_of("info", case / name, "--mapping", mapping, "--json")
        (found,) = json.loads(text)
        assert found["poses"]["count"] == 1001 and found["poses"]["rate"] == pytest.approx(50)
    assert is_right(fitted(case / name, ("--mapping", case / "m.yaml"), tmp_path)[0])


@pytest.mark.parametrize("case", ["px4_reset"], indirect=True)
def test_a_reset_of_the_estimator_is_no_motion(case, tmp_path):
    pytest.importorskip("pyulog")
    options = ("--mapping", case / "m.yaml")
    text, said = lines_of("info", case / "log_12.ulg", *options)
    assert "1001 at 50.0 Hz" in text and "nothing to correct" in text
    assert "0.35" in said and "69.00 s" in said
    assert is_right(fitted(case / "log_12.ulg", options, tmp_path)[0])


@pytest.mark.parametrize("case", ["tf_static_body"], indirect=True)
def test_a_body_behind_a_static_transform_is_found(case, tmp_path):
    frame = ("--axes", "x, -y, -z")
    text, said = lines_of("info", case / "run.bag", *frame, "--body", "base_link")
    assert "nothing to correct" in text and "0.108 m" in said and "90 deg" in said
    assert is_right(fitted(case / "run.bag", (*frame, "--body", "base_link"), tmp_path)[0])
    _, said = lines_of("info", case / "run.bag", *frame)
    assert "base_link (fixed to tracker)" in said


@pytest.mark.parametrize("case", ["commands_decimated"], indirect=True)
def test_a_log_with_one_command_in_five_is_not_believed(case, tmp_path):
    options = ("--mapping", case / "m.yaml")
    text, _ = lines_of("info", case, *options)
    assert "nothing to correct" not in text and "are missing" in text and "reacts -" not in text
    found, said = fitted(case, options, tmp_path)
    low, high = found["k"]["ci95"]
    assert low <= TRUTH["k"][0] <= high or "are missing" in said


@pytest.mark.parametrize("case", ["late_commands"], indirect=True)
def test_motion_before_its_command_is_stated_with_the_key(case, tmp_path):
    options = ("--mapping", case / "m.yaml")
    text, _ = lines_of("info", case, *options, "--json")
    (found,) = [one for one in json.loads(text)[0]["suspicions"] if one["kind"] == "clock"]
    assert "before its command" in found["evidence"]
    assert float(found["remedy"].split()[1]) == pytest.approx(0.042, abs=0.015)
    found, said = fitted(case, options, tmp_path)
    low, high = found["k"]["ci95"]
    assert low <= TRUTH["k"][0] <= high and "before its command" in said
