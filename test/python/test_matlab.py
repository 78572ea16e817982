"""Results for MATLAB and Octave, read back."""

import re

import numpy as np
import pytest
from scipy.io import loadmat, whosmat

import ground
from conftest import MODEL, identify, succeeds

NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,62}$")


def opened(path):
    """The contents of a .mat file, as attributes."""
    found = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    return {name: value for name, value in found.items() if not name.startswith("__")}


def names_in(value):
    """Names of all variables and fields."""
    if isinstance(value, dict):
        for name, item in value.items():
            yield name
            yield from names_in(item)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for item in value.ravel():
            yield from names_in(item)
    elif hasattr(value, "_fieldnames"):
        for name in value._fieldnames:
            yield name
            yield from names_in(getattr(value, name))


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory):
    """A folder with bags of two runs of a craft that turns by itself."""
    folder = tmp_path_factory.mktemp("bags")
    craft = ground.Model.load(MODEL).with_effect("yaw_bias", n0=2e-5)
    for seed in (1, 2):
        ground.simulate(craft, duration=8, seed=seed).save(folder / ("run%d.bag" % seed))
    return folder


def test_a_fit_goes_on_in_matlab(two_runs, tmp_path):
    options = "--model", MODEL, "--free", "k", "N_r", "--mat", tmp_path / "f.mat"
    said = succeeds("fit", two_runs, *options, "-o", tmp_path / "m.yaml")
    assert "f.mat" in said.stdout
    found = opened(tmp_path / "f.mat")
    fitted = ground.Model.load(tmp_path / "m.yaml")
    assert [m.label for m in found["models"]] == ["start", "fitted"]
    assert ground.Model.parse(found["models"][1].file).values == fitted.values
    (k,) = [p for p in found["parameters"] if (p.model, p.name) == ("fitted", "k")]
    assert k.value == fitted["k"] and k.unit == "N" and k.identified
    assert k.ci95[0] < k.value < k.ci95[1]
    (m,) = [p for p in found["parameters"] if (p.model, p.name) == ("start", "m")]
    assert np.isnan(m.ci95).all() and not m.identified
    assert [run.name for run in found["runs"]] == ["run1", "run2"]
    run = found["runs"][0]
    assert run.eta.shape == run.nu.shape == (len(run.t), 3)
    assert run.inputs.shape == (len(run.t), 3) and list(run.input_names) == ["left", "right", "lift"]
    assert run.commands.shape[1] == 4
    before, after = run.predicted
    assert after.model == "fitted" and after.residual.shape == (len(run.t), 6)
    assert np.allclose((run.nu - after.nu - after.residual[:, 3:])[np.isfinite(after.nu)], 0)
    there = np.isfinite(after.position_mm)
    assert there.mean() > 0.5
    assert 0 < np.mean(after.position_mm[there]) < 100
    second = [row for row in after.after if row.seconds == 1][0]
    assert 0 < second.position_mm < 100 and 0 < second.heading_deg < 60


def test_names_are_those_that_matlab_takes(two_runs, diagnosed, tmp_path):
    ground.compare({"1 given": MODEL}, two_runs / "run1.bag").to_mat(tmp_path / "c.mat")
    diagnosed.to_mat(tmp_path / "d.mat")
    for file in ("c.mat", "d.mat"):
        names = list(names_in(opened(tmp_path / file)))
        assert len(names) > 20
        assert [name for name in names if not NAME.match(name)] == []
    assert dict((name, kind) for name, _, kind in whosmat(str(tmp_path / "d.mat")))["effects"] == "struct"
    found = opened(tmp_path / "d.mat")
    assert found["verdict"] == "missing" and found["effects"].name == "yaw_bias"
    given, improved = found["runs"].predicted
    refitted, improved = found["runs"].predicted
    assert improved.after[3].heading_deg < refitted.after[3].heading_deg


def test_compare_and_diagnose_write_it_too(two_runs, tmp_path):
    turning = ground.Model.load(MODEL).with_effect("yaw_bias", n0=2e-5).save(tmp_path / "turning.yaml")
    models = ["--model", MODEL, "--model", turning.path]
    mat = tmp_path / "c.mat"
    succeeds("compare", two_runs, *models, "-o", tmp_path / "c", "--numbers", "--mat", mat)
    found = opened(mat)
    assert [m.label for m in found["models"]] == ["tiny_whoover", "turning"]
    assert [p.model for p in found["runs"][1].predicted] == ["tiny_whoover", "turning"]
    again = identify("compare", two_runs, *models, "-o", tmp_path / "d", "--numbers", "--mat", mat)
    assert again.returncode == 1 and "c.mat exists" in again.stderr
    assert not (tmp_path / "d").exists(), "refused before the work"
    only = ["--only", "yaw_bias", "-o", tmp_path / "diagnosis", "--mat", tmp_path / "d.mat"]
    succeeds("diagnose", two_runs / "run1.bag", "--model", MODEL, *only)
    assert opened(tmp_path / "d.mat")["verdict"] == "missing"
