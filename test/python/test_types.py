"""The type stub and the TypedDicts of the compiled core agree with it."""

import ast
import inspect
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import MODEL, ROOT, simulate_run

from ground import _core, core_types

STUB = ROOT / "src/ground/python/ground/_core.pyi"
ENUM_MEMBERS = {"name", "value"}  # members of every enum


def public(names):
    return {name for name in names if not name.startswith("_")}


def members(body):
    """{name: statement that defines it}."""
    found = {}
    for node in body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
            found[node.name] = node
        elif isinstance(node, ast.AnnAssign):
            found[node.target.id] = node
    return found


def arguments(function):
    """Names of the arguments of a function in the stub."""
    return [a.arg for a in function.args.args if a.arg != "self"]


def documented(function):
    """Names of the arguments in the signature that pybind11 writes into the documentation."""
    signature = function.__doc__.split("\n", 1)[0]
    return [n for n in re.findall(r"(?:\(|, )(\w+): ", signature) if n != "self"]


@pytest.fixture(scope="module")
def stub():
    return members(ast.parse(STUB.read_text()).body)


def test_stub_has_the_names_of_the_core(stub):
    assert set(stub) == public(vars(_core))


def test_classes_of_the_stub_have_the_members_of_the_core(stub):
    for name, node in stub.items():
        if isinstance(node, ast.ClassDef):
            kind = getattr(_core, name)
            real = public(vars(kind))
            if hasattr(kind, "__members__"):
                real -= ENUM_MEMBERS
            assert public(members(node.body)) == real, name


def test_the_core_loads_without_numpy():
    """Launch files start many programs that need the core alone; numpy would take half of their time."""
    script = "import sys; from ground import _core; sys.exit('numpy' in sys.modules)"
    assert subprocess.call([sys.executable, "-c", script]) == 0


def test_functions_of_the_stub_have_the_arguments_of_the_core(stub):
    checked = 0
    for name, node in stub.items():
        compiled = getattr(_core, name)
        inside = members(node.body) if isinstance(node, ast.ClassDef) else {}
        for member, function in [(None, node), *inside.items()]:
            if not isinstance(function, ast.FunctionDef) or function.decorator_list:
                continue
            real = documented(getattr(compiled, member) if member else compiled)
            assert arguments(function) == real, "%s.%s" % (name, member)
            checked += 1
    assert checked > 50


def keys(kind):
    """Keys of a TypedDict and its bases."""
    return set(kind.__annotations__)


@pytest.fixture(scope="module")
def results():
    """{name of a class in core_types: such a dictionary from the core}."""
    model = _core.load_model(str(MODEL))
    times, eta, inputs = simulate_run(duration=5.0)
    params = _core.EstimatorParams()
    smoothed = _core.smooth(times, eta, params)
    noise = [3e-4, 3e-4, 5e-3]
    run = _core.RunData("run", times, smoothed["eta"], smoothed["nu"], inputs, eta, noise)
    cut = _core.cut_windows(run, 0, 0.5, 4.5, 1.5)
    problem = _core.SimulationError([run], cut)
    fit = problem.fit(model, ["k"], threads=1)
    wrench, nature = _core.WrenchFilter(model, run), _core.WrenchNature.white
    level = wrench.likeliest_noise(nature)
    box = _core.GreyBox([run], model)
    found = box.fit(box.start(model), ["k"], max_iterations=2)
    where = [np.zeros(3), np.zeros(3), _core.MocapParams(), 1]
    return {
        "Palette": _core.palette,
        "ParameterInfo": _core.effects()["yaw_bias"]["parameters"][0],
        "ModelParameter": model.parameters()[0],
        "Thruster": model.thrusters[0],
        "EffectInfo": _core.effects()["yaw_bias"],
        "EffectUse": _core.effect_use("ModelPredictive", model),
        "FittedParameter": fit["parameters"][0],
        "Fit": fit,
        "Motion": _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3)),
        "WindowMotions": _core.predict(model, run, cut, smoothed["nu"][: len(cut)]),
        "BestMotions": problem.simulate(model),
        "Smoothed": smoothed,
        "Innovations": wrench.innovations(nature, level),
        "InferredWrench": wrench.smooth(level),
        "RunTrim": found["trims"][0],
        "GreyBoxFit": found,
        "Scores": box.scores(found["point"], ["k"]),
        "Residuals": box.residuals(found["point"], 0),
        "Forecast": box.forecast(found["point"], 0, [10], [0.5])[0],
        "ExperimentLog": _core.play_schedule(model, inputs, 2.0, *where),
    }


def test_dictionaries_of_the_core_have_the_keys_of_their_types(results):
    described = {
        name: kind
        for name, kind in vars(core_types).items()
        if inspect.isclass(kind) and kind.__module__ == core_types.__name__
    }
    assert set(described) - set(results) == {"Estimate"}  # a part of FittedParameter
    for name, result in results.items():
        assert set(result) == keys(described[name]), name
