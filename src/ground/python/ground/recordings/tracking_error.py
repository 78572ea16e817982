"""Error and effort with which a craft followed its reference."""

from typing import Dict, Optional

import numpy as np

from ground.annotations import Array, Flags

AT_BOUND = 1e-6  # an input this near to 0 or 1 is saturated


def saturated(inputs: Array) -> Flags:
    """Whether an input of each row (n, k) is at a bound (n,). Of two thrusters, the bounds are 0 and 1;
    more of them, or those that go backwards, are off without being at a limit."""
    high = np.abs(inputs) >= 1 - AT_BOUND
    if inputs.shape[1] == 2 and not (inputs < 0).any():
        high |= inputs <= AT_BOUND
    return np.asarray(high.any(axis=1))


def summary(errors: Array, inputs: Array) -> Dict[str, Optional[float]]:
    """Numbers of position errors (n,) [m] and inputs (k, n), 0..1: rms, max and final error [m], share of
    the time in which an input is at a bound, mean square of the inputs. None where there are no
    rows."""
    numbers = dict.fromkeys(("rms", "max", "final", "saturated_fraction", "effort"))
    if len(errors):
        numbers["rms"] = float(np.sqrt(np.mean(errors**2)))
        numbers["max"] = float(errors.max())
        numbers["final"] = float(errors[-1])
    if len(inputs):
        numbers["saturated_fraction"] = float(saturated(inputs).mean())
        numbers["effort"] = float(np.mean(inputs**2))
    return numbers


def wanted_summary(wanted: Array) -> Dict[str, Optional[float]]:
    """Share of rows outside 0..1 (two thrusters) or -1..1 before the inputs were limited, and the
    largest value; None without rows."""
    least = 0.0 if wanted.shape[1] == 2 else -1.0
    outside = ((wanted < least - AT_BOUND) | (wanted > 1 + AT_BOUND)).any(axis=1)
    return {
        "wanted_outside": float(outside.mean()) if len(wanted) else None,
        "wanted_largest": float(np.abs(wanted).max()) if len(wanted) else None,
    }


def compute_ms(seconds: Array) -> Optional[Dict[str, float]]:
    """Median, 99.9% and maximum of the processor time of decisions [ms]; None without decisions."""
    if not len(seconds):
        return None
    found = 1e3 * np.asarray(seconds)
    return {
        "median": float(np.median(found)),
        "p999": float(np.quantile(found, 0.999)),
        "max": float(found.max()),
    }
