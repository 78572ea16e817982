"""All that is found out about one model on one run."""

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
    """Errors of a model on a _core.RunData, where they are, what stays in the residuals and which
    wrench is missing, as a dictionary.

    role: "fit" or "held_out", of the run to the model. wrench_of: another model; then also how much of
    the wrench that is missing it accounts for. Raises GroundError when the model cannot be simulated
    along the run.
    """
    try:
        evaluation = comparison.evaluate(run, model)
        where = failure.of_error(evaluation, failure.variables(run, model.input_max))
        wrench_filter, rest, events = failure.undisturbed(model, run)
        correlation = residuals.analyse(wrench_filter, rest)
        missing = failure.of_wrench(wrench_filter, rest, model, events, wrench_of)
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
        "summary": words.summary(numbers, where, correlation, missing.numbers),
    }
