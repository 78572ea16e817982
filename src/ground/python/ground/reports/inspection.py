"""Inspection of one model on one run."""

from ground import _core
from ground.analysis import comparison, missing_wrench, residuals
from ground.annotations import Document
from ground.errors import GroundError
from ground.reports import words


def inspect(run: _core.RunData, model: _core.Model, label: str, role: str = "fit") -> Document:
    """Errors of a model on a _core.RunData, correlations of the residuals and the missing wrench, as a
    dictionary.

    role: the run's role for the model, "fit" or "held_out". Raises GroundError when the model cannot be
    simulated along the run.
    """
    try:
        evaluation = comparison.evaluate(run, model)
        calm = missing_wrench.undisturbed(model, run)
        correlation = residuals.analyse(calm.filter, calm.run, model)
        missing = missing_wrench.of_wrench(calm, model)
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
        "residuals": correlation,
        "missing": missing,
        "summary": words.summary(numbers, correlation, missing.numbers, residuals.commands(model)),
    }
