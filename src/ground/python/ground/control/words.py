"""Numbers of drives in words."""

from typing import Iterator

from ground.annotations import Document


def effort_lines(numbers: Document) -> Iterator[str]:
    """Lines on the inputs of a drive, simulated or recorded; numbers that are None were not
    recorded."""
    if numbers["saturated_fraction"] is not None:
        yield "saturated  %.1f%% of the time" % (100 * numbers["saturated_fraction"])
        yield "effort     %.3f (mean square of the inputs)" % numbers["effort"]
    if numbers["wanted_outside"] is not None:
        yield "wanted     outside 0..1 for %.1f%% of the time, %.2f at most" % (
            100 * numbers["wanted_outside"],
            numbers["wanted_largest"],
        )
    if numbers["compute_ms"] is not None:
        yield (
            "computing  %(median).3f ms median, %(p999).3f ms 99.9%%, %(max).3f ms at most, "
            "per decision" % numbers["compute_ms"]
        )


def metres(value: float) -> str:
    """A length in mm below 0.1 m, else in m."""
    return "%.2f mm" % (1e3 * value) if value < 0.1 else "%.3f m" % value
