"""Effects that a model may have: of the library, of formulas, or of a Python function."""
