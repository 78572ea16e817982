"""Parameters of a model, as the core describes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, Tuple, TypedDict

from ground import _core


@dataclass(frozen=True)
class ParameterInfo:
    """What is known of a parameter whatever its value."""

    name: str  #: "k", or "EFFECT.PARAMETER"
    unit: str
    doc: str  #: what it is, in words
    neutral: float  #: value at which it does nothing
    lower: float  #: bounds
    upper: float
    shape: bool  #: whether it does nothing where the other parameters of its effect are neutral
    scale: float  #: typical size for the craft


class FittedParameter(TypedDict, total=False):
    """An estimated parameter, as fits of the core return it. A score test has no start, and no at_bound."""

    name: str  #: "k", or "EFFECT.PARAMETER"
    unit: str
    start: float  #: where the fit began
    value: float
    ci95: Tuple[float, float]  #: 95% interval
    deviation: float  #: standard deviation
    at_bound: bool
    identified: bool
    runs: Tuple[float, float]  #: where runs do not agree, the least and the largest of their own values


def described(model: _core.Model) -> Dict[str, ParameterInfo]:
    """All parameters of a model by name, in the model's order."""
    return {p["name"]: ParameterInfo(**p) for p in model.parameters()}
