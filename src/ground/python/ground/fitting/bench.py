"""identify bench: thrust from forces that were measured on a bench."""

import argparse
import os
from dataclasses import asdict
from typing import Dict, Iterator, List, Sequence, Tuple

import numpy as np
import yaml

from ground import _core
from ground.data import bag_arguments
from ground.effect_library import candidates
from ground.fitting import bench_forces, bench_logs, bench_motion, thrust_bench
from ground.fitting.bench_logs import BenchFormat
from ground.fitting.bench_motion import WithInterval
from ground.fitting.fit import fit
from ground.models import Model, with_provenance
from ground.support import command_line, files
from ground.support.errors import GroundError, warn
from ground.support.headline import Line, formatted
from ground.support.origin import digest_of_files
from ground.support.quantities import quantity, with_interval

EFFECTS = {"a": "thrust_asymmetry", "p": "thrust_curve"}  # of a left and a right thruster
CURVES = ("linear", "power", "polynomial")
REACH = 0.8  # least largest input measured; otherwise thrust at an input of 1 is an extrapolation


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.add_argument(
        "tables",
        metavar="BENCH.csv",
        nargs="+",
        help="a table: columns input, then thrusters by name (left, right), a+b or both, repeated ones as "
        "left_1, left_2; or logs of a load cell: columns of time, force and command",
    )
    parser.add_argument("--model", metavar="M.yaml", required=True, help="model whose thrust is replaced")
    parser.add_argument("-o", "--output", metavar="N.yaml", required=True)
    parser.add_argument(
        "--inputs",
        type=float,
        nargs=2,
        default=(0.0, 1.0),
        metavar=("OFF", "FULL"),
        help="values of the column input that mean 0 and 1, such as PWM microseconds (0 1)",
    )
    parser.add_argument(
        "--unit",
        choices=sorted(bench_logs.NEWTONS),
        help="unit of the forces (N; of a log the unit in its column's name)",
    )
    parser.add_argument(
        "--log-columns",
        metavar=("TIME", "FORCE", "COMMAND"),
        nargs=3,
        default=(),
        help="names of a log's columns, where they are not found",
    )
    parser.add_argument(
        "--thrusters",
        metavar="NAME",
        nargs="+",
        help="thrusters that were measured together in every column, or their number if it does not "
        "matter which",
    )
    parser.add_argument(
        "--curve", choices=CURVES, help="kind of curve (the simplest that the forces do not reject)"
    )
    parser.add_argument(
        "--runs",
        metavar="BAG",
        nargs="+",
        default=[],
        help="recorded runs, to compare the bench with motion and to estimate the mass",
    )
    bag_arguments.add_reading_arguments(parser)
    parser.add_argument("--force", action="store_true", help="overwrite the model file")
    command_line.add_details(parser)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    off, full = arguments.inputs
    if not (np.isfinite([off, full]).all() and full != off):
        arguments.refuse("--inputs needs two different numbers")
    model = Model.load(arguments.model).core
    names = [one["name"] for one in model.thrusters]
    form = BenchFormat(names, off, full, arguments.unit, arguments.thrusters, arguments.log_columns)
    measured = bench_forces.read(arguments.tables, form)
    for remark in measured.remarks:
        warn(remark)
    found = thrust_bench.fit(measured, names, arguments.curve)
    with_thrust, factors = _put_into(model, found, arguments.model)
    fitted = with_provenance(
        with_thrust,
        [os.path.basename(table) for table in arguments.tables],
        {},
        {"bench": found.residual},
        {name: _scaled(found.intervals[short], factor) for short, (name, factor) in factors.items()},
        [],
        [digest_of_files(arguments.tables)],
    )
    windows = motion = None
    agrees: List[str] = []
    if arguments.runs:
        runs = list(bag_arguments.reading(arguments, arguments.runs))
        k = WithInterval(found.values["k"], *found.intervals["k"])
        windows = fit(fitted, runs, progress=arguments.work)
        motion = bench_motion.motion(fitted, k, runs, bag_arguments.Part(), arguments.work)
        at = "at full input" if found.curve.power is not None else "at %.3g" % found.curve.largest
        over = bench_motion.over_windows(windows, fitted.core.value("k"), at)
        agrees = [over, *motion.lines(), motion.verdict(windows)]
    fitted.save(arguments.output, arguments.force)
    mass = motion.mass if motion else ""
    for line in formatted(_headline(found, arguments, mass, agrees[-1:])):
        command_line.say(arguments, line)
    timing = [measured.source] * bool(measured.source)
    timing += measured.timing.lines() if measured.timing else []
    command_line.say_details(arguments, [*_lines(found), *timing, *agrees])
    return {
        "model": arguments.output,
        "curve": "switch" if found.switches else found.curve.kind,
        "parameters": {n: {"value": v, "ci95": list(found.intervals[n])} for n, v in found.values.items()},
        "p_equal_gains": found.p_value,
        "rejected": [{"curve": words, "evidence_ratio": ratio} for words, ratio in found.rejected],
        "residual": found.residual,
        "scatter": None if np.isnan(found.scatter) else found.scatter,
        "largest_input": found.curve.largest,
        "k_before": model.value("k") * model.input_max,
        "timing": asdict(measured.timing) if measured.timing else None,
        "left_out": list(measured.remarks),
        "motion": windows.to_dict() if windows else None,
        "mass": motion.to_dict() if motion else None,
    }


#: The parameter of a model for a value of a fit, and the factor between them.
Places = Dict[str, Tuple[str, float]]


def _put_into(model: _core.Model, found: thrust_bench.Thrust, path: str) -> Tuple[_core.Model, Places]:
    """The model with the fitted thrust, and where its values are there. A curve that is no power is
    written with the thrusters listed."""
    if model.is_pair and found.curve.power is not None:
        return _put_into_pair(model, found)
    if model.input_max != 1:
        raise GroundError(
            "%s has inputs up to %g, which are not normalised: a %s cannot be written into it; "
            "--curve power can" % (path, model.input_max, found.curve.words)
        )
    plain = _without_effects(model, found)
    document = yaml.safe_load(plain.format())
    body = document["body"]
    body.pop("l", None)
    body.pop("input_max", None)
    pair = [  # as model files list them
        {
            "name": one["name"],
            "position": [float(x) for x in one["position"]],
            "direction": float(one["direction"]),
        }
        for one in plain.thrusters
    ]
    listed = body.setdefault("thrusters", pair)
    for thruster, gain in zip(listed, found.gains):
        if (found.gains != 1).any():
            thruster["gain"] = float(gain)
        if found.curve.power is None:
            thruster["curve"] = {"table": [list(row) for row in found.curve.table()]}
            low = min(0.0, *(float(r) for r in thruster.get("range", [0.0])))
            if low < 0:
                raise GroundError(
                    "%s: %s is reversible: the bench has no forces of negative inputs, so write its "
                    "curve into the model file" % (path, thruster["name"])
                )
            thruster["range"] = [0.0, found.curve.largest]
        elif not found.switches:
            thruster["curve"] = {"power": found.values.get("p", 1.0)}
    body["k"] = found.values["k"]
    fitted = _core.parse_model(yaml.safe_dump(document, sort_keys=False), path)
    return fitted, {"k": ("k", 1.0)}


def _without_effects(model: _core.Model, thrust: thrust_bench.Thrust) -> _core.Model:
    """The model without effects on the thrust of a pair, of which the bench says more."""
    found = model.copy()
    for name, effect in EFFECTS.items():
        if effect in found.effects and not (thrust.switches and name == "p"):
            found.remove_effect(effect)
    return found


def _scaled(interval: Tuple[float, float], factor: float) -> Tuple[float, float]:
    return factor * interval[0], factor * interval[1]


def _put_into_pair(model: _core.Model, found: thrust_bench.Thrust) -> Tuple[_core.Model, Places]:
    """The model of a left and a right thruster with the fitted thrust."""
    fitted = _without_effects(model, found)
    fitted.set_value("k", found.values["k"] / model.input_max)
    places: Places = {"k": ("k", 1 / model.input_max)}
    if "p" in found.values:
        fitted = candidates.of_library(EFFECTS["p"]).neutral(fitted)
        fitted.set_value("thrust_curve.p", found.values["p"])
        places["p"] = ("thrust_curve.p", 1.0)
    if (found.gains != 1).any():
        fitted = candidates.of_library(EFFECTS["a"]).neutral(fitted)
        fitted.set_value("thrust_asymmetry.a", float(found.gains[0] - 1))
    return fitted, places


def _headline(
    found: thrust_bench.Thrust, arguments: argparse.Namespace, mass: str, agrees: Sequence[str]
) -> Iterator[Line]:
    """The first lines: the curve, how well it fits, and what to do next."""
    curve = found.curve
    values = [
        "%s %s" % (name, with_interval(value, *found.intervals[name], "N" if name == "k" else ""))
        for name, value in found.values.items()
    ]
    kind = "on or off" if found.switches else curve.words
    yield "Thrust", "%s: %s." % (kind, ", ".join(values))
    if mass:
        yield "Mass by motion", mass
    yield "Misfit", "%s (standard deviation)" % quantity(found.residual, "N", 2)
    yield "Model", arguments.output
    if curve.power is not None and curve.largest < REACH:
        yield "Next", "measure at inputs above %.2g: k at full input is an extrapolation" % curve.largest
    elif agrees:
        yield "Next", agrees[-1]
    else:
        yield "Next", "compare with motion: the same command with --runs BAG"


def _lines(found: thrust_bench.Thrust) -> Iterator[str]:
    """The evidence: curve, parameters, misfit and reach."""
    curve = found.curve
    if found.switches:
        yield "curve: on or off; nothing was measured between, so the model's is kept"
    else:
        yield "curve: %s" % curve.words
    for words, ratio in found.rejected:
        yield "  not a %s (%.2g times as likely)" % (words, ratio)
    at = "at full input" if curve.power is not None else "at input %.3g" % curve.largest
    for name, value in found.values.items():
        means = "of a thruster %s" % at if name == "k" else "exponent of the input"
        yield "%s = %s, %s" % (
            name,
            with_interval(value, *found.intervals[name], "N" if name == "k" else ""),
            means if name in ("k", "p") else "relative to the mean of all thrusters",
        )
    if found.p_value is not None and not (found.gains != 1).any():
        yield "no sign of unequal thrusters (p %.2g)" % found.p_value
    yield "forces are %.2g N from the fit (standard deviation)%s" % (
        found.residual,
        "" if np.isnan(found.scatter) else ", repetitions %.2g N from each other" % found.scatter,
    )
    if curve.power is not None and curve.largest < REACH:
        yield (
            "no input above %.2g was measured: k at full input is an extrapolation, and may be far off"
            % curve.largest
        )
