"""A page on this computer: compare a model with runs, see where it fails, add what is missing."""
