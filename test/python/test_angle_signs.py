"""An angle that is recorded with the wrong sign is named; an honest one is not."""

import numpy as np
import pytest

import ground
from conftest import ROOT, SHARED
from ground import _core
from ground.checks import suspicions
from ground.reading.recording import Recording

ESSO = SHARED.parent / "others" / "frt_ds_esso"
MAPPING = """
schema: ground/mapping/1
poses:
  position: {fields: ["x_position_mid [m]", "y_position_mid [m]"]}
  heading: {field: "psi_hat [rad]", unit: rad}
  time: {field: "t [s]"}
commands:
  time: {field: "t [s]"}
  channels:
    propeller: {field: "n_prop [rps]", off: 0, full: 13, range: [-1, 1]}
    rudder: {field: "delta_rudder [rad]", off: 0, full: 0.61, range: [-1, 1], sign: SIGN}
"""


def steered(name, held, duration, noise, sign, seed=1):
    """A simulated craft with a propeller or fan and a rudder, steered at random."""
    model = ground.Model.load(ROOT / "cfg" / "craft" / name).core
    random = np.random.default_rng(seed)
    edges = np.arange(0, duration, held)
    inputs = np.column_stack(
        [edges, np.full(len(edges), 0.7), random.uniform(-0.8, 0.8, len(edges)), np.ones(len(edges))]
    )
    times = np.arange(0, duration, min(0.1, held / 10))
    eta = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))["eta"]
    eta = eta + random.normal(size=eta.shape) * np.array(noise)[[0, 0, 1]]
    inputs[:, 1 + [one["is_angle"] for one in model.thrusters].index(True)] *= sign
    run = Recording("run", times, eta, inputs[:, 0], inputs[:, 1:], "made up", channels=tuple(model.channels))
    return [one for one in suspicions.about([run], model) if one.misread]


@pytest.mark.parametrize(
    "craft",
    [("one_fan_rudder.yaml", 0.5, 60.0, (5e-4, 5e-3)), ("propeller_ship.yaml", 40.0, 3000.0, (0.02, 2e-3))],
    ids=["hovercraft", "ship"],
)
def test_the_wrong_sign_of_a_rudder_is_named(craft):
    (finding,) = steered(*craft, sign=-1)
    assert finding.evidence.startswith("the angle rudder seems to have the wrong sign")
    assert "of rudder under commands.channels" in finding.remedy
    assert not steered(*craft, sign=1)


@pytest.mark.skipif(not ESSO.exists(), reason="needs recordings of a model ship, which are not shared")
@pytest.mark.parametrize("sign", [1, -1])
def test_the_wrong_sign_of_a_recorded_ship_is_named(sign, tmp_path):
    (tmp_path / "mapping.yaml").write_text(MAPPING.replace("SIGN", str(sign)))
    model = ground.Model.load(ROOT / "cfg" / "craft" / "propeller_ship.yaml").core
    runs = [run.with_lift_of(model) for run in ground.read(ESSO, mapping=tmp_path / "mapping.yaml")]
    found = [one for one in suspicions.about(runs, model) if one.misread]
    assert [one.kind for one in found] == (["invert"] if sign < 0 else [])
