"""Values of a model in another unit are named by what a recording makes of them."""

import pytest

from conftest import MODEL, identify, write_bag
from ground import _core
from ground.fitting import unit_slips

FITTED = {"I_z": 8.8e-5, "X_u": 0.0055, "Y_v": 0.0271, "N_r": 4.62e-5, "k": 0.062}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("grams") / "run.bag", seed=3, duration=12.0)


def craft(**values):
    model = _core.load_model(str(MODEL))
    for name, value in values.items():
        model.set_value(name, value)
    return model


@pytest.mark.parametrize(
    "typed, written, advice",
    [
        ("m: 58.3", "m: 0.0583", "if its m is in g: write m: 0.0583  # kg in the model"),
        ("I_z: 880", "I_z: 8.8e-5", "if its I_z is in g cm^2: write I_z: 8.8e-05  # kg m^2"),
        ("k: 6.32", "k: 0.062", "if its k is in grams of force: write k: 0.062  # N"),
    ],
)
def test_a_fit_says_in_which_unit_a_value_was_typed(typed, written, advice, bag, tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text(MODEL.read_text().replace(written, typed))
    result = identify("fit", bag, "--model", model, "-o", tmp_path / "fitted.yaml")
    assert result.returncode == 0, result.stderr
    (remark,) = [line for line in result.stdout.splitlines() if "are multiples" in line]
    assert advice in remark and "is implausible" in result.stderr


def test_other_changes_are_no_slips():
    assert unit_slips.found(craft(), FITTED) is None
    assert unit_slips.found(craft(k=0.3, X_u=0.1, N_r=1e-6), FITTED) is None  # a rough guess
    assert unit_slips.found(craft(m=58.3), {"k": 62.0}) is None  # the others are not free
    assert unit_slips.found(craft(), {}) is None
