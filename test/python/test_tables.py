"""The .cfg files and --help agree with the core's tables of controllers and references."""

import ast
import runpy

import pytest
from conftest import ROOT, program

CONTROLLERS = ["TrajectoryTracking", "ModelPredictive", "OpenLoopPRBS"]
NOT_LIVE = {"order", "seed"}  # parameters of OpenLoopPRBS that are read at its start only


@pytest.fixture
def configured(monkeypatch):
    """configured(NAME) gives the parameters of cfg/NAME.cfg by name."""
    from dynamic_reconfigure.parameter_generator_catkin import ParameterGenerator

    def read(name):
        found = {}

        def generate(generator, *_):
            found.update({p["name"]: p for p in generator.group.get_parameters()})

        monkeypatch.setattr(ParameterGenerator, "generate", generate)
        monkeypatch.setattr("sys.argv", ["cfg"] + 4 * [""])
        with pytest.raises(SystemExit):
            runpy.run_path(str(ROOT / "cfg" / (name + ".cfg")), run_name="__main__")
        return found

    return read


def controller(name):
    from ground.simulation import gains

    return gains.CONTROLLERS[name].parameters


def described(parameter):
    """The entry in a .cfg file that a _core.TunableInfo should have."""
    entry = dict(name=parameter.name, type=parameter.type, default=parameter.default)
    entry["description"] = parameter.text + (" [%s]" % parameter.unit if parameter.unit else "")
    if parameter.type in ("double", "int"):
        entry.update(min=parameter.low, max=parameter.high)
    return entry


def assert_same(parameters, fields, but=()):
    for wanted in map(described, parameters):
        found = {key: fields[wanted["name"]][key] for key in wanted}
        assert {k: v for k, v in found.items() if k not in but} == {
            k: v for k, v in wanted.items() if k not in but
        }


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controllers_cfg_agrees_with_the_core(configured, name):
    parameters = [p for p in controller(name) if p.name not in NOT_LIVE]
    assert len(parameters) >= 6
    assert_same(parameters, configured(name))


@pytest.mark.parametrize("name", ["TrajectoryTracking", "ModelPredictive"])
def test_a_cfg_has_no_parameter_unknown_to_the_core(configured, name):
    from ground import _core

    known = {p.name for p in [*controller(name), *_core.reference_parameters()]}
    common = {"rate", "duration", "max_error", "lift", "lift_time", "state_timeout"}
    assert set(configured(name)) == known | common | {"reference", "recovery_time"}


def test_a_references_cfg_agrees_with_the_core(configured):
    from ground import _core

    fields = configured("ModelPredictive")
    assert_same(_core.reference_parameters(), fields)
    offered = ast.literal_eval(fields["reference"]["edit_method"])["enum"]
    kinds = [(kind["value"], kind["description"]) for kind in offered]
    assert kinds == [(info.name, info.text) for info in _core.reference_table()]
    assert fields["reference"]["default"] == _core.ReferenceParams().kind


def test_the_observer_of_live_comparison_has_the_same_ranges(configured):
    fields = configured("LiveComparison")
    observer = [p for p in controller("ModelPredictive") if p.name in fields and p.name != "horizon"]
    assert len(observer) == 6
    assert_same(observer, fields, but=["default"])


@pytest.mark.parametrize("verb", ["track", "tune"])
def test_help_contains_the_tables(verb):
    from ground import _core

    result = program(verb, "--help")
    assert result.returncode == 0
    for info in _core.controller_table():
        assert (info.text in result.stdout) == info.follows
    for info in _core.reference_table():
        assert info.text in result.stdout
    for parameter in controller("ModelPredictive"):
        assert parameter.text in result.stdout
    assert "k_e                Position error [kg/s], 1e-06 to 100 (4) *" in result.stdout
    assert "x 0, y 0, size 1.5, petals 1.5, rate_of_turn 0.4" in result.stdout
    assert "x 0, y 0, end_x 2.5, end_y 2.5, speed 0.707, smooth false" in result.stdout


@pytest.mark.parametrize("kind", ["TrajectoryTracking", "ModelPredictive", "OpenLoopPRBS"])
def test_all_parameters_of_a_controller_are_written_and_read_back(kind, tmp_path):
    from ground.simulation import gains

    values = {}
    for number, parameter in enumerate(controller(kind), 2):
        inside = parameter.low + (parameter.high - parameter.low) / number
        values[parameter.name] = round(inside) if parameter.type == "int" else float("%.4g" % inside)
    choice = gains.choice(kind, values)
    assert choice.values == values != gains.choice(kind).values
    path = gains.write(str(tmp_path / "gains.yaml"), choice, [])
    assert gains.choice(kind, path).values == values
