"""identify thrust: thrust from forces that were measured on a bench."""

import argparse
import os
from typing import Dict, Iterator, Tuple

import numpy as np

from ground import _core, files
from ground.analysis import candidates, thrust_bench
from ground.annotations import Document
from ground.api.models import Model, with_provenance
from ground.errors import GroundError
from ground.verbs import common

NEWTONS = {"N": 1.0, "mN": 1e-3, "g": 9.80665e-3}
EFFECTS = {"a": "thrust_asymmetry", "p": "thrust_curve"}
MEANS = {
    "k": "thrust of one thruster at full input",
    "a": "left stronger than right",
    "p": "exponent of the input",
}
REACH = 0.8  # least largest input measured; otherwise k is an extrapolation


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.add_argument(
        "table",
        metavar="BENCH.csv",
        help="columns input, then left, right or both thrusters, repeated ones as left_1, left_2",
    )
    parser.add_argument("--model", metavar="M.yaml", required=True, help="model whose thrust is replaced")
    parser.add_argument("-o", "--output", metavar="N.yaml", required=True)
    parser.add_argument(
        "--inputs",
        type=float,
        nargs=2,
        default=(0.0, 1.0),
        metavar=("OFF", "FULL"),
        help="values of the column input that mean 0 and 1, such as microseconds of PWM (0 1)",
    )
    parser.add_argument("--unit", choices=sorted(NEWTONS), default="N", help="unit of the forces (N)")
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    off, full = arguments.inputs
    if not (np.isfinite([off, full]).all() and full != off):
        arguments.refuse("--inputs needs two different numbers")
    model = Model.load(arguments.model).core
    if not model.is_pair:
        raise GroundError(
            "%s lists its thrusters: a table of a left and a right one says nothing of them; put their "
            "gains and curves into the model file" % arguments.model
        )
    bench = thrust_bench.read(arguments.table, off, full, NEWTONS[arguments.unit])
    found = thrust_bench.fit(bench)
    fitted, names = _put_into(model, found)
    # a model's k is for an input of 1, a bench's for the largest input
    units = {n: 1 / model.input_max if n == "k" else 1.0 for n in found.values}
    intervals = {
        names[n]: (units[n] * low, units[n] * high) for n, (low, high) in found.intervals.items()
    }
    full_thrust = model.value("k") * model.input_max
    before = thrust_bench.Thrust({"k": full_thrust}, {}, {}, 0.0, 0.0).force(bench)
    with_provenance(
        fitted,
        [os.path.basename(arguments.table)],
        {"bench": float(np.sqrt(np.mean((before - bench.forces) ** 2)))},
        {"bench": found.residual},
        intervals,
        [],
    ).save(arguments.output, arguments.force)
    reach = float(bench.inputs.max())
    for line in _lines(arguments, model, found, reach):
        common.say(arguments, line)
    scatter = None if np.isnan(found.scatter) else found.scatter
    return {
        "model": arguments.output,
        "parameters": {
            n: {"value": v, "ci95": list(found.intervals[n])} for n, v in found.values.items()
        },
        "p_values": found.p_values,
        "residual": found.residual,
        "scatter": scatter,
        "largest_input": reach,
        "k_before": full_thrust,
    }


def _put_into(model: _core.Model, found: thrust_bench.Thrust) -> Tuple[_core.Model, Dict[str, str]]:
    """The model with the fitted thrust, and its parameters' names there."""
    fitted, names = model.copy(), {"k": "k"}
    for short, effect in EFFECTS.items():
        if effect in fitted.effects:
            fitted.remove_effect(effect)
        if short in found.values:
            fitted = candidates.of_library(effect).neutral(fitted)
            names[short] = "%s.%s" % (effect, short)
    for short, name in names.items():
        value = found.values[short]
        fitted.set_value(name, value / model.input_max if short == "k" else value)
    return fitted, names


def _lines(
    arguments: argparse.Namespace, model: _core.Model, found: thrust_bench.Thrust, reach: float
) -> Iterator[str]:
    for name, value in found.values.items():
        yield "%s = %.4g%s [%.4g, %.4g]  %s" % (
            name,
            value,
            " N" if name == "k" else "",
            *found.intervals[name],
            MEANS[name],
        )
    if "a" in found.values:
        k, a = found.values["k"], found.values["a"]
        yield "left %.4g N, right %.4g N at full input" % (k * (1 + a), k * (1 - a))
    for name, p_value in found.p_values.items():
        if name not in found.values:
            yield "no sign of %s (p %.2g)" % (EFFECTS[name], p_value)
    yield "forces are %.2g N from the fit (standard deviation)%s" % (
        found.residual,
        "" if np.isnan(found.scatter) else ", repetitions %.2g N from each other" % found.scatter,
    )
    if found.scatter and found.residual > 2 * found.scatter:
        yield "the fit misses more than repetitions scatter: thrust is not a power of the input here"
    if reach < REACH:
        yield (
            "no input above %.2g was measured: k at full input is an extrapolation, and may be far off"
            % reach
        )
    before = model.value("k") * model.input_max
    ratio = found.values["k"] / before
    if abs(ratio - 1) > 0.05:
        yield (
            "%s has %.3g N at full input: the bench gives %.2f times that. Thrust that is fitted to "
            "motion is relative to the mass: losses at speed, a low battery, a wrong mass or a wrong "
            "lever make the two differ. Fit runs with k free before a controller uses this model."
            % (arguments.model, before, ratio)
        )
    yield "written to %s" % arguments.output
