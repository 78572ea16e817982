"""Stages of a diagnosis, as its progress names them."""

FITTING = "fitting the model as it is"
SEARCHING = "searching for missing effects"  # unit: a set of effects that is refitted
TESTING = "testing effects on held-out data"  # unit: an effect
IMITATING = "testing whether effects imitate what has no name"
ORDERING = "ordering the effects"  # unit: an effect
RIVALS = "looking for effects that could replace them"  # unit: an effect
SIMULATING = "searching by simulation error"  # unit: an effect that is fitted
LEAVING = "testing what the model leaves"
ERRORS = "errors of the best effects"
