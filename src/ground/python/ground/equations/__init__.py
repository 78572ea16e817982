"""A model's equations as code of other languages."""
