"""The core's tables of controllers and references: in .cfg files, --help and files of gains."""

import ast
import runpy

import pytest

from conftest import ROOT, program

CONTROLLERS = ["TrajectoryTracking", "ModelPredictive"]


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


def test_the_kinds_of_references_in_a_cfg_are_those_of_the_core(configured):
    from ground import _core

    fields = configured("ModelPredictive")
    offered = ast.literal_eval(fields["reference"]["edit_method"])["enum"]
    kinds = [(kind["value"], kind["description"]) for kind in offered]
    assert kinds == [(info.name, info.text) for info in _core.reference_table()]
    assert fields["reference"]["default"] == _core.ReferenceParams().kind


def test_tune_searches_inside_the_ranges():
    from ground.simulation import tuning

    for name, space in tuning.SPACE.items():
        parameters = {p.name: p for p in controller(name)}
        for gain, (sign, *powers) in space.items():
            for power in powers:
                assert parameters[gain].low <= sign * 10.0**power <= parameters[gain].high


@pytest.mark.parametrize("verb", ["track", "tune"])
def test_help_contains_the_tables(verb):
    from ground import _core

    result = program(verb, "--help")
    assert result.returncode == 0
    for info in _core.controller_table():
        assert info.text in " ".join(result.stdout.split())
    for info in _core.reference_table():
        assert info.text in " ".join(result.stdout.split())
    for parameter in controller("ModelPredictive"):
        assert parameter.text in " ".join(result.stdout.split())


@pytest.mark.parametrize("kind", CONTROLLERS)
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
