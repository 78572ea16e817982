"""The Python API: one module for each verb, beside those of models, rooms and recordings."""
