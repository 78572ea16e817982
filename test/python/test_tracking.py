"""identify tracking: how a recorded craft followed its reference."""

import json

import pytest

from conftest import MODEL, identify, json_of, succeeds, write_bag

CIRCLE = ["--input", "tracking", "--reference", "circle", "--size", "1", "--duration", "15"]


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    bag = tmp_path_factory.mktemp("tracking") / "circle.bag"
    options = ["--controller", "ModelPredictive", "--json", "-o", bag]
    result = succeeds("simulate", "--model", MODEL, *CIRCLE, *options)
    return bag, json.loads(result.stdout)


def tracking(*arguments):
    return json_of("tracking", *arguments)


def test_the_error_equals_that_of_the_simulation(driven, tmp_path):
    bag, simulated = driven
    picture = tmp_path / "drive.html"
    found = tracking(bag, "--picture", picture)
    (drive,) = found["runs"][0]["drives"]
    # computed from mocap poses at 100 Hz instead of the truth at each decision
    assert drive["rms"] == pytest.approx(simulated["tracking_error"], rel=0.02)
    assert drive["duration"] == pytest.approx(15, abs=0.1)
    assert 0 < drive["saturated_fraction"] < 1
    assert (drive["controller"], drive["kind"]) == ("/controller", "ModelPredictive")
    assert 0 < drive["wanted_outside"] < 1 < drive["wanted_largest"]
    assert drive["compute_ms"]["median"] > 0
    assert picture.stat().st_size > 20000
    (settled,) = tracking(bag, "--settled", 5)["runs"][0]["drives"]
    assert settled["rms"] < 0.01 < drive["rms"]
    assert settled["saturated_fraction"] < drive["saturated_fraction"]


def test_a_bag_without_a_reference_is_refused(tmp_path):
    bag = write_bag(tmp_path / "prbs.bag")
    result = identify("tracking", bag)
    assert result.returncode == 1
    assert "no reference was recorded" in result.stderr and "Traceback" not in result.stderr
    result = identify("tracking", tmp_path / "nowhere.bag")
    assert result.returncode == 1 and "no such file" in result.stderr.lower()


def test_several_runs_are_a_table_with_a_row_for_each(driven, tmp_path):
    weak = tmp_path / "weak.yaml"
    weak.write_text(MODEL.read_text().replace("k: 0.062", "k: 0.05"))
    other = tmp_path / "weak.bag"
    options = ["--controller", "ModelPredictive", "-o", other]
    succeeds("simulate", "--model", weak, *CIRCLE, *options)
    printed = identify("tracking", driven[0], other, "--settled", 5).stdout
    found = tracking(driven[0], other, "--settled", 5)
    table = printed.split("Next:")[0].splitlines()
    assert len(table) == 3, "a header and a row for each run"
    for row, run, model in zip(table[1:], found["runs"], ("tiny_whoover.yaml", "weak.yaml")):
        assert row.split()[0] == run["run"] and model in row
        assert "%.2f mm" % (1e3 * run["drives"][0]["rms"]) in row
    assert len({line.index("ModelPredictive") for line in table[1:]}) == 1  # columns
