"""Code of a model against the core, at random states."""

import ctypes
import os
import shutil
import subprocess
import tempfile
import types
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

import numpy as np

from ground import _core
from ground.equations.statements import POSE_AND_VELOCITY, Equations
from ground.support.annotations import Array
from ground.support.errors import GroundError

COUNT = 1000  # random states
LARGEST = 1e-9  # relative difference that rounding may cause
AT_REST = 50  # of the states, with inputs that are off
SMALL = 1e-3  # of the largest value of a column: below, differences are relative to this
PLACE, TIME = 5.0, 120.0  # places [m] and times [s] reach so far
STEPS = (1e-3, 2e-2)  # [s]
Values = Dict[str, Array]  # derivative, step (n, 6 + k) and measure (n, 6)


def compared(equations: Equations, code: str, to: str, prefix: str) -> Tuple[Optional[float], str]:
    """The largest relative difference of the code's results from the core's at COUNT random states; None
    and why, where the code cannot run here. GroundError when it is more than LARGEST."""
    given = samples(equations)
    try:
        with np.errstate(all="ignore"):
            found = RUN[to](code, prefix, *given)
    except MissingLibrary as missing:
        return None, str(missing)
    expected = _core.evaluate(equations.core, *given)
    largest = 0.0
    for name, values in found.items():
        differences = _differences(values, expected[name])
        at = int(np.argmax(differences))
        if not differences[at] <= LARGEST:
            names = [symbol.name for symbol in equations.states]
            raise GroundError(
                "the exported %s() differs from the model in %s, by a share of %.1g: nothing was written; an "
                "effect of this model cannot be exported (remove effects to see which one)"
                % (name, names[at], differences[at])
            )
        largest = max(largest, float(differences[at]))
    return largest, ""


def _differences(found: Array, expected: Array) -> Array:
    """The largest relative difference of each column; infinite where only one of them is finite."""
    known, same = np.isfinite(expected), np.isfinite(found) == np.isfinite(expected)
    least = SMALL * np.max(np.abs(expected), axis=0, initial=0.0, where=known)
    off = np.where(same, 0.0, np.inf)
    both = same & known
    size = np.maximum(np.abs(expected), least)[both]
    off[both] = np.abs(found[both] - expected[both]) / np.where(size > 0, size, 1.0)
    return np.asarray(off.max(axis=0))


def samples(equations: Equations, seed: int = 1) -> Tuple[Array, Array, Array, Array]:
    """Random states (n, 6 + k), inputs (n, m + 1), times and steps (n,) [s] of a craft, some of them at
    rest."""
    random, core = np.random.default_rng(seed), equations.core
    force = 2 * core.value("k") * core.input_max
    speed = 2 * np.sqrt(force / core.value("m"))
    turn = 2 * np.sqrt(force * core.value("l") / core.value("I_z"))
    states = 2 * random.random((COUNT, len(equations.states))) - 1
    states[:, : len(POSE_AND_VELOCITY)] *= (PLACE, PLACE, np.pi, speed, speed, turn)
    states[:, len(POSE_AND_VELOCITY) :] += equations.initial
    ends = np.array([np.array(t["range"]) * core.input_max for t in core.thrusters] + [(0, 1)])
    inputs = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * random.random((COUNT, len(ends)))
    states[:AT_REST, 3:6] = inputs[:AT_REST, :-1] = 0.0
    times = TIME * random.random(COUNT)
    return states, inputs, times, STEPS[0] * (STEPS[1] / STEPS[0]) ** random.random(COUNT)


class MissingLibrary(Exception):
    """What is not on this computer, so that code cannot run; the message says what to do."""


def loaded(code: str) -> Any:
    """The module of Python code."""
    module = types.ModuleType("exported")
    exec(compile(code, "the exported code", "exec"), vars(module))
    return module


def _run_numpy(code: str, prefix: str, states: Array, inputs: Array, t: Array, dt: Array) -> Values:
    module = loaded(code)
    return {
        "derivative": module.derivative(states, inputs, t),
        "step": module.step(states, inputs, dt, t),
        "measure": module.measure(states),
    }


def _run_casadi(code: str, prefix: str, states: Array, inputs: Array, t: Array, dt: Array) -> Values:
    try:
        module = loaded(code)
    except ImportError as error:
        raise MissingLibrary("CasADi is not installed (pip install casadi)") from error
    derivative, step, measure = module.functions()
    found = {
        "derivative": derivative(states.T, inputs.T, t[np.newaxis]),
        "step": step(states.T, inputs.T, dt[np.newaxis], t[np.newaxis]),
        "measure": measure(states.T),
    }
    return {name: np.array(values).T for name, values in found.items()}


# Calls the functions for rows of states.
ROWS = """
void rows(int n, const double *states, const double *inputs, const double *t, const double *dt,
          double *rates, double *next, double *measured) {
  for (int i = 0; i < n; ++i, states += PREFIX_STATES, inputs += PREFIX_INPUTS, rates += PREFIX_STATES,
           next += PREFIX_STATES, measured += 6) {
    PREFIX_derivative(&PREFIX_given, states, inputs, t[i], rates);
    for (int j = 0; j < PREFIX_STATES; ++j) next[j] = states[j];
    PREFIX_step(&PREFIX_given, next, inputs, dt[i], t[i]);
    PREFIX_measure(&PREFIX_given, states, measured);
  }
}
"""


def _run_c(code: str, prefix: str, states: Array, inputs: Array, t: Array, dt: Array) -> Values:
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if not compiler:
        raise MissingLibrary("there is no C compiler here (cc)")
    shape = len(states), states.shape[1]
    found = {"derivative": np.empty(shape), "step": np.empty(shape), "measure": np.empty((len(states), 6))}
    with tempfile.TemporaryDirectory(prefix="ground-") as folder:
        source, library = os.path.join(folder, "model.c"), os.path.join(folder, "model.so")
        with open(source, "w", encoding="utf-8") as file:
            file.write(code + named(ROWS, prefix))
        command = [*compiler.split(), "-std=c99", "-shared", "-fPIC", source, "-o", library, "-lm"]
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        except (OSError, subprocess.CalledProcessError) as error:
            why = (getattr(error, "stderr", None) or str(error).encode()).decode(errors="replace")
            raise MissingLibrary(
                "%s does not compile it: %s" % (compiler, (why.split("\n") or [why])[0])
            ) from error
        arrays = [np.ascontiguousarray(a) for a in (states, inputs, t, dt)] + list(found.values())
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in arrays]
        ctypes.CDLL(library).rows(ctypes.c_int(len(states)), *pointers)
    return found


def named(code: str, prefix: str) -> str:
    """C code with the names of a model."""
    for constant in ("STATES", "INPUTS", "KEPT"):
        code = code.replace("PREFIX_" + constant, "%s_%s" % (prefix.upper(), constant))
    return code.replace("PREFIX", prefix)


RUN: Mapping[str, Callable[..., Values]] = {"numpy": _run_numpy, "casadi": _run_casadi, "c": _run_c}
