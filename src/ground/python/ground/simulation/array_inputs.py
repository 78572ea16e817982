"""Inputs of a simulated experiment that a script gives as an array or a table."""

from typing import TYPE_CHECKING, Any, Union

import numpy as np

from ground import _core
from ground.support.annotations import Array, ArrayLike
from ground.support.errors import GroundError

if TYPE_CHECKING:
    import pandas

Inputs = Union[ArrayLike, "pandas.DataFrame"]


def rows_of(inputs: Any, model: _core.Model) -> Array:
    """Rows of time [s], commands. GroundError when a model cannot play them."""
    channels = list(model.channels)
    if hasattr(inputs, "columns"):
        lift = channels[-1:] if channels[-1] in inputs else []
        wanted = ["t", *channels[:-1], *lift]
        missing = [name for name in wanted if name not in inputs]
        if missing:
            raise GroundError("inputs have no column %s" % ", ".join(missing))
        inputs = inputs[wanted].dropna()
    try:
        rows = np.array(inputs, float)
    except (TypeError, ValueError) as error:
        raise GroundError("inputs are not numbers (%s)" % error)
    if rows.ndim != 2 or rows.shape[1] - 1 not in (len(channels) - 1, len(channels)) or len(rows) < 2:
        text = "inputs have the shape %s; they need (n, %d) for t, %s, or one column less without the lift"
        raise GroundError(text % (rows.shape, 1 + len(channels), ", ".join(channels)))
    if not np.isfinite(rows).all() or rows[0, 0] < 0 or (np.diff(rows[:, 0]) <= 0).any():
        raise GroundError("inputs must be finite, and their times ascend from 0 or later")
    ends = [*(t["range"] for t in model.thrusters), (0.0, 1.0)]
    for name, values, (low, high) in zip(channels, rows[:, 1:].T, ends):
        if values.min() < low or values.max() > high:
            reach = name, values.min(), values.max(), low, high
            raise GroundError("inputs of %s range from %g to %g, not %g to %g" % reach)
    return rows
