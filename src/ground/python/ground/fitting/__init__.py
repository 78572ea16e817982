"""fit: a model's parameters from recordings."""
