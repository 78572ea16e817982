"""Angles."""

import numpy as np

from ground.support.annotations import Array, ArrayLike


def wrap(angle: ArrayLike) -> Array:
    """The angle [rad] within a half turn of zero."""
    return np.asarray(np.angle(np.exp(1j * np.asarray(angle))))
