"""Stages of a diagnosis, as its progress names them."""

FITTING = "fitting the model as it is"
SEARCHING = "searching for missing effects"  # unit: a set of effects that is refitted
TESTING = "testing effects on held-out data"  # unit: an effect
REMEMBERING = "testing whether the motion depends on the past"
ORDERING = "ordering the effects"  # unit: an effect
RIVALS = "looking for effects that could replace them"  # unit: an effect
LEAVING = "testing what the model leaves"
ERRORS = "errors of the best effects"
REPEATING = "repeating the search without each part of the data"
