"""diagnose: which physical effect is missing in a model."""
