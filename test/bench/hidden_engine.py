"""The one place at which the hidden-effect bench calls the project's diagnosis."""

import time

from ground.analysis import candidates, diagnosis, diagnosis_report
from ground.analysis.conclusion import conclude
from ground.errors import GroundError


def diagnose(runs, heldout, model, thorough=False):
    """What the tool says of runs, lists of _core.RunData, as plain values for a line of JSON.

    heldout: runs to test on; without any, errors are those of each run by a fit to the others.
    The dictionary has:
      verdict, floor   as in diagnosis.json
      seconds          that it took
      chosen           effects in the order of their choice
      groups           {chosen effect: effects that are its equals}
      first            the three effects that rank first beside the nominal model
      p_values         {effect: beside the nominal model, not corrected for the number tried}
      errors           fit: nominal and improved; steps: held out, nominal and after each step
      parameters       of the improved model: name, value, ci95, identified
      varies           names of what it says differs from run to run; None if it cannot say
      memory           whether it says that history matters; None if it cannot say
      unseen           effects that it says these runs cannot show
    thorough adds alike {candidate: its group}, next_experiment, and where (the variables of what is
    unexplained). {"failed": why} is all there is when the tool refuses.
    """
    start = time.perf_counter()
    try:
        found = diagnosis.Diagnosis(runs, model, candidates.library(model), threads=1)
        found.grow()
        conclusion = conclude(found, heldout)
    except GroundError as error:
        return {"failed": str(error)}
    told = {
        "seconds": time.perf_counter() - start,
        "verdict": conclusion.verdict,
        "chosen": [c.name for c in found.chosen],
        "groups": {s.added: list(s.group) for s in found.steps},
        "first": [t.name for t in found.tried[:3]],
        "p_values": {t.name: t.p_value for t in found.tried},
        "errors": {
            "fit": [float(found.nominal.error.sum()), float(found.best.error.sum())],
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
            for p in conclusion.parameters
        ],
        "varies": [v["parameter"] for v in conclusion.varies],
        "memory": conclusion.verdict == "memory",
        "memory_kind": conclusion.memory and conclusion.memory.kind.name,
        "left": {
            "memory": [
                conclusion.history.p_value,
                conclusion.history.gain,
                conclusion.history.share,
            ],
            "state": [conclusion.state.p_value, conclusion.state.gain, conclusion.state.share],
        },
        "unseen": found.hidden_names(),
        "dropped": {d.trial.name: d.why for d in found.dropped},
        "slight": found.slight and found.slight.name,
    }
    if thorough:
        report = diagnosis_report.of(found, conclusion, model.name, heldout)
        told["alike"] = {c["effect"]: c["group"] for c in report["candidates"]}
        told["next_experiment"] = report["next_experiment"]
        told["where"] = [w["variable"] for w in report["unexplained"]["where"]]
    return told
