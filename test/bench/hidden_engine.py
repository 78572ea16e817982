"""The only module of the hidden-effect bench that calls the project's diagnosis."""

import contextlib
import dataclasses
import os
import time
import warnings

import ground
from ground.analysis import diagnosis, horizon, window_error
from ground.analysis.likelihood import Likelihood
from ground.analysis.verdict import HeldOutRuns, conclude
from ground.checks import quality
from ground.data.measured import repaired
from ground.effect_library import candidates
from ground.support.errors import GroundError
from ground.support.progress import Work


def diagnose(runs, heldout, model):
    """Diagnosis of runs, lists of _core.RunData, as plain values for a line of JSON.

    heldout: runs to test on; if empty, each run is tested with a fit to the others.
    The dictionary has:
      verdict, floor   as in diagnosis.json
      seconds          computing time
      chosen           effects in the order of their choice
      groups           {chosen effect: effects that the diagnosis declares equal to it}
      first            the three effects that rank first when added to the nominal model
      p_values         {effect: p-value when added to the nominal model, uncorrected}
      errors           fit: nominal and improved; steps: held out, nominal and after each step
      parameters       of the improved model: name, value, ci95, identified
      varies           names of the parameters that it reports as different from run to run
      memory           whether it reports that history matters
      where            arguments that the learnable part of the error depends on, most first
      ceiling          shares [value, low, high] that are named, learnable and chance; arguments
                       {name: share}; formula, the proposal in words; kept, the error on held-out runs
                       with it; agrees, whether what is left is the random wrench that the model claims
      unseen           effects that it reports as not identifiable from these runs
    If the tool refuses the runs, the result is {"failed": reason}.
    """
    start = time.perf_counter()
    try:
        found = diagnosis.StepwiseDiagnosis(runs, model, candidates.library(model), threads=1)
        found.grow()
        conclusion = conclude(found, heldout)
    except GroundError as error:
        return {"failed": str(error)}
    return {"seconds": time.perf_counter() - start, **_answer(found, conclusion)}


def _answer(found, conclusion):
    """The plain values of a diagnosis.StepwiseDiagnosis and its conclusion."""
    return {
        "verdict": conclusion.verdict,
        "chosen": [c.name for c in found.chosen],
        "groups": {s.added: list(s.group) for s in found.steps},
        "first": [t.name for t in found.tried[:3]],
        "p_values": {t.name: t.p_value for t in found.tried},
        "errors": {
            "fit": [float(conclusion.before.error.sum()), float(found.best.error.sum())],
            "steps": [float(error) for error in conclusion.heldout],
        },
        "floor": float(conclusion.noise_floor),
        "parameters": [
            {
                "name": p["name"],
                "value": p["value"],
                "ci95": list(p["ci95"]),
                "identified": bool(p["identified"]),
            }
            for p in conclusion.after.parameters
        ],
        "varies": [v.parameter for v in conclusion.varies],
        "memory": conclusion.verdict == "memory",
        "where": list(conclusion.ceiling.arguments),
        "ceiling": _ceiling(found, conclusion),
        "unseen": found.hidden_names(),
        "dropped": {d.trial.name: d.why for d in found.dropped},
    }


def _ceiling(found, conclusion):
    """The shares of the error, and what was proposed for the learnable one."""
    left, formula = conclusion.ceiling, conclusion.formula
    shares = {
        name: [share.value, share.low, share.high]
        for name, share in (("named", left.named), ("learnable", left.learnable), ("chance", left.chance))
    }
    kept = None
    if formula:
        tested = conclusion.tested
        kept = (
            float(HeldOutRuns(found, tested).error(formula.fit.model, formula.fit).sum())
            if tested
            else float(found.folds.judge(formula.fit).heldout.sum())
        )
    return {
        **shares,
        "arguments": left.arguments,
        "formula": formula and formula.means,
        "kept": kept,
        "agrees": conclusion.agreement.holds,
    }


def answer(recordings, model):
    """What `ground.diagnose` tells a user about recordings of a _core.Model, as plain values, and models.

    The values: `verdict`, `chosen`, `groups`, `parameters`, `seconds` until it is told, seconds of
    `processor` time, `lines` [label, text], `horizon` [s] of its prediction (None: too short), `unsmoothed`,
    whether it takes the poses as before a low-pass of the mocap. The _core.Models by name: improved (None: it
    offers none), given, and without effects, refitted by the tool, by simulation error and by likelihood.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        given, start, began = ground.Model(model), time.perf_counter(), sum(os.times()[:4])
        found = ground.diagnose(given, recordings)
        seconds, report = time.perf_counter() - start, found.report
        work = sum(os.times()[:4]) - began
        models = {"given": model}
        with contextlib.suppress(GroundError):
            models["simulation"] = ground.fit(given, recordings).model.core
        with contextlib.suppress(GroundError):
            runs = [quality.repaired(recording).data(model) for recording in recordings]
            models["likelihood"] = Likelihood(runs, model).fit(model, window_error.NOMINAL).model
    models["tool"] = model.copy()
    for name, parameter in report["nominal"]["parameters"].items():
        models["tool"].set_value(name, parameter["value"])
    models["improved"] = None if found.verdict == "misread" else found.improved.core
    told = {
        "verdict": found.verdict,
        "chosen": list(found.effects),
        "groups": {step["added"]: list(step["group"]) for step in report["steps"]},
        "parameters": {name: p["value"] for name, p in report["improved"]["parameters"].items()},
        "seconds": seconds,
        "processor": work,
        "lines": [list(line) for line in found.headline("diagnosis")],
        "horizon": report["prediction"] and report["prediction"]["seconds"],
        "promised": report["prediction"] and report["prediction"]["errors"],
        "unsmoothed": all(run.motion.low_pass for run in recordings),
    }
    return told, models


def kept(recordings, models, horizon_of):
    """Errors of predicted poses of recordings that were never given to the tool, as it measures them: for
    each of some _core.Models by name, position_mm and heading_deg. horizon_of: time of a prediction [s]."""
    first = next(iter(models.values()))
    runs = [run.data(first) for run in repaired(recordings, Work(), first)]
    starts = horizon.Starts.of(runs, horizon_of)
    errors = {name: starts.errors(runs, [model] * len(starts.windows)) for name, model in models.items()}
    return {name: dataclasses.asdict(horizon.PoseError.of(found)) for name, found in errors.items()}
