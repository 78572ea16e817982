"""simulate: a recording of a simulated experiment."""
