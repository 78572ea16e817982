"""export: a model in the language of another program."""
