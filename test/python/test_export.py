"""A model as code of another language computes what the model computes."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, identify, located, succeeds
from ground import _core

JETS = ROOT / "cfg" / "craft" / "air_table.yaml"
FOUR = ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"
STEP = 0.005  # longest step of a simulation [s]
EXACT = 1e-9  # relative

FORMULAS = """
  - name: everything
    expression:
      X: "-c * (u > 0 ? u^2 : -abs(u)^1.5) + (r < 0 ? c : v > 0 ? 2 * c : -c) * u_L"
      Y: "c * sin(x) * max(u, v, r) - 2e-1 * c * (u_R > 0.5 && lift > .2 || v != 0.25) * tanh(3 * v)"
      N: "1e-3 * c * (atan2(v, u + 1.5) + log10(2 + cos(psi)) - sign(r) * min(1, t) + avg(u, v, 1))"
    parameters: {c: {value: 0.004, unit: N, neutral: 0}}
"""


def crafts():
    """Models by name: each effect of the library alone, and a dozen of random combinations."""
    random = np.random.default_rng(3)
    craft, jets = ground.Model.load(MODEL), ground.Model.load(JETS)
    found = {"no effect": craft}
    for given, library in ((craft, _core.effects()), (jets, _core.effects(jets.core))):
        names = [name for name in library if given is craft or name not in _core.effects()]
        for name in names:
            found[name] = _with(given, [name], random)
        for _ in range(6):
            several = sorted(random.choice(list(library), 5, replace=False))
            found["%s with %s" % (given.name, ", ".join(several))] = _with(given, several, random)
    return found


def _with(craft, names, random):
    """The craft with effects that change its motion clearly."""
    for name in names:
        craft = craft.with_effect(name)
        for p in [p for p in craft.core.parameters() if p["name"].startswith(name + ".")]:
            value = p["neutral"] + p["scale"] * random.uniform(0.5, 1.5)
            if np.isinf(p["neutral"]):
                value = 1 / (p["scale"] * random.uniform(0.5, 1.5))
            if p["unit"] == "s" and name == "input_delay":
                value = STEP * round(value / STEP)  # the command then changes between two steps
            craft = craft.with_values({p["name"]: float(np.clip(value, p["lower"], p["upper"]))})
    return craft


CRAFTS = crafts()


def loaded(path):
    """The module in a Python file."""
    spec = importlib.util.spec_from_file_location(path.stem, str(path))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def commands(craft, seed=0, count=12, hold=6):
    """Rows of time, inputs and lift of a short drive; each command holds for some steps."""
    random = np.random.default_rng(seed)
    ends = np.array([np.array(t["range"]) * craft.core.input_max for t in craft.core.thrusters])
    times = np.arange(count) * hold * STEP
    levels = random.uniform(ends[:, 0], ends[:, 1], (count, len(ends)))
    return np.column_stack([times, levels, random.uniform(0.6, 1.0, count)])


def flown(craft, inputs, eta=(0.3, -0.2, 0.5), nu=(0.4, -0.2, 1.0), steps=70):
    """What a simulation of the model measures at each step."""
    times = np.arange(steps + 1) * STEP
    run = _core.simulate(craft.core, inputs, times, np.array(eta, float), np.array(nu, float))
    return times, np.column_stack([run["eta"], run["nu"]])


def flown_by(module, inputs, times, eta=(0.3, -0.2, 0.5), nu=(0.4, -0.2, 1.0)):
    """The same by exported code, step by step."""
    state, found = np.array([*eta, *nu, *module.INITIAL]), []
    delayed = module.Delay() if hasattr(module, "Delay") else None
    for t in times:
        found.append(np.ravel(module.measure(state)))
        acting = inputs[np.searchsorted(inputs[:, 0], t + 1e-9) - 1, 1:]
        acting = delayed(t, acting) if delayed else acting
        state = np.ravel(module.step(state, acting, STEP, t))
    return np.array(found)


@pytest.mark.parametrize("name", CRAFTS)
def test_numpy_code_flies_as_the_model_does(name, tmp_path):
    craft = CRAFTS[name]
    craft.export(tmp_path / "craft.py")
    inputs = commands(craft)
    times, expected = flown(craft, inputs)
    found = flown_by(loaded(tmp_path / "craft.py"), inputs, times)
    assert np.allclose(found, expected, rtol=EXACT, atol=EXACT)


def test_parameters_are_symbols_that_may_be_changed(tmp_path):
    craft = ground.Model.load(MODEL).with_effect("battery_sag", tau=90).with_effect("motor_lag", tau=0.05)
    craft.export(tmp_path / "craft.py")
    values = {"k": 0.08, "I_z": 1.2e-4, "motor_lag.tau": 0.02, "battery_sag.tau": np.inf}
    module, changed = loaded(tmp_path / "craft.py"), craft.with_values(values)
    assert module.PARAMETERS == craft.values
    changed.export(tmp_path / "changed.py")
    state, inputs = np.linspace(0.1, 0.8, 8), (0.4, 0.9, 1.0)
    own = module.derivative(state, inputs, 30.0, {**module.PARAMETERS, **values})
    expected = _core.evaluate(changed.core, state[np.newaxis], np.array([inputs]), [30.0], [0.01])
    assert np.allclose(own, expected["derivative"][0], rtol=EXACT)
    assert "battery_sag.tau" not in loaded(tmp_path / "changed.py").PARAMETERS, "it changes nothing"


def with_entry(entry):
    """The craft with an effect as model files list it."""
    text = ground.Model.load(MODEL).format()
    assert "effects:\n  []" in text
    return ground.Model.parse(text.replace("effects:\n  []", "effects:" + entry))


def special_crafts():
    """Models beyond the library's effects."""
    jets = ground.Model.load(JETS)
    return {
        "formulas": with_entry(FORMULAS),
        "a table of thrust": ground.Model.load(FOUR),
        "eight jets": jets.with_effect("motor_lag", tau=0.03),
        "memory": remembering(),
        "delayed": ground.Model.load(MODEL).with_effect("input_delay", delay=0.04),
    }


def remembering():
    """A craft whose effect has states."""
    entry = """
  - name: fan
    states: {w: {derivative: (u_L + u_R - w) / tau, initial: 0.1}}
    expression: {N: c * w * w, thrust_L: -2 * c * w}
    parameters:
      c: {value: 0.001, unit: N m, neutral: 0}
      tau: {value: 0.2, unit: s, neutral: 0.2, lower: 0.02, upper: 2}
"""
    return with_entry(entry)


@pytest.mark.parametrize("to", ["numpy", "c", "casadi"])
@pytest.mark.parametrize("name", ["formulas", "a table of thrust", "eight jets", "memory", "delayed"])
def test_every_kind_of_model_is_exported(name, to, tmp_path):
    craft = special_crafts()[name]
    if to == "casadi":
        pytest.importorskip("casadi")
    path = tmp_path / ("craft.h" if to == "c" else "craft.py")
    written = craft.export(path, to)
    assert written.difference < EXACT
    if to == "numpy":
        inputs = commands(craft)
        times, expected = flown(craft, inputs)
        assert np.allclose(flown_by(loaded(path), inputs, times), expected, rtol=EXACT, atol=EXACT)


@pytest.mark.parametrize(
    "formula",
    [
        "-u^2 + 2^-v - (-r)^2 - 2^sin(u)^3",
        "u > 0 ? v > 0 ? 1 : r : v < 0 ? u : 2",
        "(u > 0) * v + (r >= 1) / 2 - (u < v) ^ 2 + (u <= v) + (t == 1)",
        "u / 2 / 3 * v - r - 1 - t + .5e-2 + 1e1",
        "sin(u) + cos(v) * tan(r) + asin(u / 9) + acos(v / 9) + atan(r)",
        "sinh(u) + cosh(v) * tanh(r) + asinh(u) + acosh(2 + v^2) + atanh(u / 9)",
        "exp(u) + ln(2 + u^2) + log(3 + v^2) + log2(4 + r^2) + log10(5 + t) + sqrt(1 + u^2)",
        "abs(u) + sign(v) + rint(10 * r) + atan2(u, v)",
        "min(u, v, r) - max(u, v, 0.1) + sum(u, v, 1) * avg(u_L, u_R, lift)",
        "u > 0 && v > 0 || r > 0 && u_1 != 0 ? pi : x * y * cos(psi)",
    ],
)
def test_formulas_mean_what_they_mean_in_a_model_file(formula, tmp_path):
    entry = """
  - name: own
    expression: {X: "c * (%s)"}
    parameters: {c: {value: 0.01, unit: N}}
"""
    craft = with_entry(entry % formula)
    for file in ("craft.py", "craft.h"):
        assert craft.export(tmp_path / file).difference < EXACT


@pytest.mark.parametrize("to", ["c", "casadi"])
def test_other_languages_agree_for_all_effects(to, tmp_path):
    if to == "casadi":
        pytest.importorskip("casadi")
    for i, craft in enumerate(CRAFTS.values()):
        written = craft.export(tmp_path / ("craft%d.%s" % (i, "c" if to == "c" else "py")), to)
        assert written.difference < EXACT


def test_derivatives_of_casadi_exist_at_rest(tmp_path):
    ca = pytest.importorskip("casadi")
    craft = (
        CRAFTS["no effect"].with_effect("quadratic_drag", cx=0.01, cy=0.01).with_effect("thrust_curve", p=0.7)
    )
    craft.with_effect("motor_lag", tau=0.05).export(tmp_path / "craft.py", "casadi")
    _, step, _ = loaded(tmp_path / "craft.py").functions()
    x, u = ca.SX.sym("x", 8), ca.SX.sym("u", 3)
    next_state = step(x, u, 0.02, 0)
    curvature, _ = ca.hessian(ca.sumsqr(next_state), x)
    slopes = ca.Function("slopes", [x, u], [ca.jacobian(next_state, x), curvature])
    assert all(np.isfinite(np.array(one)).all() for one in slopes(np.zeros(8), np.zeros(3)))


USE = """
#include <stdio.h>
#include "craft.h"
int main(void) {
  double state[CRAFT_STATES] = {0}, measured[6];
  const double inputs[CRAFT_INPUTS] = {0.8, 0.4, 1.0};
  static craft_line line;
  craft_parameters own = craft_given;
  own.k *= 1.1;
  for (int i = 0; i < 100; ++i)
    craft_step(&own, state, craft_delayed(&own, &line, 0.01 * i, inputs), 0.01, 0.01 * i);
  craft_measure(&own, state, measured);
  for (int i = 0; i < 6; ++i) printf("%.15g\\n", measured[i]);
  return 0;
}
"""


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no C compiler")
@pytest.mark.parametrize("compiler", [["cc", "-std=c99"], ["c++", "-xc++"]])
def test_a_program_in_c_uses_the_header(compiler, tmp_path):
    craft = ground.Model.load(MODEL).with_effect("input_delay", delay=0.05).with_effect("motor_lag", tau=0.05)
    succeeds("export", _saved(craft, tmp_path), "-o", tmp_path / "craft.h")
    (tmp_path / "use.c").write_text(USE)
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "use.c", "-o", "use", "-lm"]
    subprocess.run([*compiler, *strict], cwd=str(tmp_path), check=True)
    found = [float(x) for x in subprocess.check_output(["./use"], cwd=str(tmp_path)).split()]
    stronger = craft.with_values({"k": 1.1 * craft["k"]})
    run = _core.simulate(
        stronger.core, np.array([[0.0, 0.8, 0.4, 1.0]]), [0.0, 1.0], np.zeros(3), np.zeros(3)
    )
    assert np.allclose(found, np.concatenate([run["eta"][-1], run["nu"][-1]]), rtol=1e-4, atol=1e-6)


def test_the_page_shows_c_that_compiles(tmp_path):
    """test_examples.py runs its Python."""
    page = (ROOT / "docs" / "howto" / "own_controller.md").read_text()
    declared, used = re.search(r"\n## C\n.*?```\w+\n(.*?)```", page, re.S).group(1).split("\n\n")
    ground.Model.load(MODEL).export(tmp_path / "craft.h")
    (tmp_path / "use.c").write_text("%s\nint main(void) {\n%s\n  return 0;\n}\n" % (declared, used))
    command = ["cc", "-std=c99", "-Werror", "use.c", "-o", "use", "-lm"]
    subprocess.run(command, cwd=str(tmp_path), check=True)


def _saved(craft, folder):
    return craft.save(folder / "craft.yaml").path


def test_a_user_exports_a_model_and_reads_what_was_written(tmp_path):
    craft = _saved(ground.Model.load(MODEL).with_effect("motor_lag", tau=0.05), tmp_path)
    said = succeeds("export", craft, "-o", tmp_path / "craft.py")
    assert "motor_lag.left" in said.stdout and re.search("1000 random states", said.stdout)
    text = (tmp_path / "craft.py").read_text()
    assert "time constant [s]" in text and "1000 random states" in text
    again = identify("export", craft, "-o", tmp_path / "craft.py")
    assert again.returncode == 1 and "exists" in again.stderr
    listed = identify("export", craft, "-o", tmp_path / "craft.h", "--json")
    found = json.loads(listed.stdout)
    assert found["to"] == "c" and found["states"][-1] == "motor_lag.right" and found["inputs"][-1] == "lift"


def _at_voltage(path, volts, effect):
    """The craft whose thrust is known at a voltage, with an effect."""
    text = Path(MODEL).read_text()
    text = re.sub(r"(?m)^(  k: .*)$", r"\1\n  volts: %g" % volts, text)
    path.write_text(re.sub(r"(?m)^effects:.*$", "effects:\n" + effect, text))
    return ground.Model.load(path)


FORCE_BY_VOLT = """
  - name: lamp
    expression: {X: "c * %s"}
    parameters: {c: {value: 0.004, unit: N, neutral: 0}}
"""


@pytest.mark.parametrize(
    "effect, name",
    [
        ("  - {name: battery_voltage, p: 2}\n", "battery_voltage"),
        (FORCE_BY_VOLT % "u * volt", "lamp"),
        (FORCE_BY_VOLT % "(volt > 3.5 ? 1 : 0)", "lamp"),
        ("  - {name: quadratic_drag, cx: 0.01, cy: 0, cr: 0}\n" + FORCE_BY_VOLT % "sqrt(volt)", "lamp"),
    ],
)
def test_what_depends_on_the_voltage_is_refused_and_never_dropped(effect, name, tmp_path):
    craft = _at_voltage(tmp_path / "battery.yaml", 3.9, effect)
    for to in ("numpy", "casadi", "c"):
        with pytest.raises(ground.GroundError, match="effect %s cannot be exported.*voltage" % name):
            craft.export(tmp_path / "craft.txt", to)
    said = identify("export", tmp_path / "battery.yaml", "-o", tmp_path / "craft.py")
    assert said.returncode == 1 and name in said.stderr and said.stderr.count("\n") == 1, said.stderr
    assert not list(tmp_path.glob("craft*"))


@pytest.mark.parametrize("effect", ["  - {name: battery_voltage, p: 0}\n", FORCE_BY_VOLT % "u"])
def test_a_craft_of_known_voltage_is_exported_if_nothing_depends_on_it(effect, tmp_path):
    _at_voltage(tmp_path / "battery.yaml", 3.9, effect).export(tmp_path / "craft.py")


def test_what_cannot_be_exported_is_said_in_a_line(tmp_path):
    craft = _saved(ground.Model.load(MODEL), tmp_path)
    for arguments, words in (
        ((craft, "-o", tmp_path / "craft.txt"), "--to"),
        ((craft, "-o", tmp_path / "nowhere" / "craft.py"), "there is no folder"),
        ((tmp_path / "none.yaml", "-o", tmp_path / "craft.py"), "none.yaml"),
        ((craft, "-o", craft, "--to", "c", "--force"), "input"),
    ):
        said = identify("export", *arguments)
        assert said.returncode == 1 and words in said.stderr, said.stderr
        assert said.stderr.count("\n") == 1
    assert identify("export", craft, "-o", tmp_path / "craft.py", "--to", "fortran").returncode == 2
    with pytest.raises(ground.GroundError, match="fortran"):
        ground.Model.load(MODEL).export(tmp_path / "craft.py", "fortran")
    assert not (tmp_path / "craft.py").exists()


EFFECT = """
#include "ground/model/effect_registry.h"
namespace ground {
struct Own {
  static EffectInfo info() {
    return {"own", "drag ahead", {{"c", "N s/m", "drag", 0, 0, 1, [](const Body<double>&) { return 0.1; }}}};
  }
  template <typename T>
  static void wrench(const T* p, const Point<T>& point, Vector3<T>& wrench) {
    const T& u = point.nu.x();
    %s
  }
};
GROUND_REGISTER_EFFECT(Own)
}  // namespace ground
"""


@pytest.mark.parametrize(
    "line, works",
    [
        ("wrench(0) -= select(u > 0.1, T(p[0] * u * point.lift), T(0.0));", True),
        ("if (u > 0.1) wrench(0) -= p[0] * u * point.lift;", False),
    ],
)
def test_an_effect_of_another_library_is_exported_or_named(line, works, tmp_path):
    libraries = Path(_core.__file__).parents[3]
    (tmp_path / "own.cpp").write_text(EFFECT % line)
    include = ["-I", str(ROOT / "src" / "ground" / "include"), "-isystem", "/usr/include/eigen3"]
    link = ["-L", str(libraries), "-lground_model", "-Wl,-rpath," + str(libraries)]
    options = ["-std=c++17", "-shared", "-fPIC", *include, "own.cpp", *link, "-o", "libown.so"]
    subprocess.run(["g++", *options], cwd=str(tmp_path), check=True)
    entry = "\n  - {name: own, c: 0.01}\n  - {name: yaw_bias, n0: 1.0e-5}\n"
    text = ground.Model.load(MODEL).format().replace("effects:\n  []", "effects:" + entry)
    (tmp_path / "craft.yaml").write_text(text)
    said = subprocess.run(
        [located("identify"), "export", "craft.yaml", "-o", "craft.py"],
        cwd=str(tmp_path),
        env=dict(os.environ, GROUND_EFFECT_LIBRARIES=str(tmp_path / "libown.so")),
        capture_output=True,
        text=True,
    )
    assert said.returncode == (0 if works else 1), said.stderr
    assert (tmp_path / "craft.py").exists() == works
    if not works:
        assert re.match("identify export: effect own .*select", said.stderr) and said.stderr.count("\n") == 1


def test_c_without_a_compiler_is_written_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "/no/compiler")
    written = ground.Model.load(MODEL).export(tmp_path / "craft.h")
    assert written.difference is None and "/no/compiler" in str(written)
    assert "not compared" in (tmp_path / "craft.h").read_text()


def test_names_of_a_model_cannot_end_a_comment(tmp_path):
    text = ground.Model.load(MODEL).format()
    name = re.search("^name: (.*)$", text, re.M).group(1)
    craft = ground.Model.parse(text.replace(name, '\'*/ """ \\ x\''))
    for file in ("craft.py", "craft.h"):
        assert craft.export(tmp_path / file).difference < EXACT
