"""Inspection of one model on one run."""

from typing import Optional

from ground import _core
from ground.analysis import comparison, failure, residuals
from ground.annotations import Document
from ground.errors import GroundError
from ground.reports import words


def inspect(
    run: _core.RunData,
    model: _core.Model,
    label: str,
    role: str = "fit",
    wrench_of: Optional[_core.Model] = None,
) -> Document:
    """Errors of a model on a _core.RunData, what they depend on, correlations of the residuals and the
    missing wrench, as a dictionary.

    role: the run's role for the model, "fit" or "held_out". wrench_of: another model, to compute how
    much of the missing wrench it accounts for. Raises GroundError when the model cannot be simulated
    along the run.
    """
    try:
        evaluation = comparison.evaluate(run, model)
        where = failure.of_error(evaluation, failure.variables(run, model))
        calm = failure.undisturbed(model, run)
        correlation = residuals.analyse(calm.filter, calm.run, model)
        missing = failure.of_wrench(calm, model, wrench_of)
    except (ValueError, RuntimeError) as error:
        raise GroundError("%s with %s: %s" % (run.name, label, error))
    numbers = comparison.numbers([evaluation])
    return {
        "label": label,
        "run": run,
        "model": model,
        "role": role,
        "evaluation": evaluation,
        "numbers": numbers,
        "where": where,
        "residuals": correlation,
        "missing": missing,
        "summary": words.summary(
            numbers, where, correlation, missing.numbers, residuals.commands(model)
        ),
    }
