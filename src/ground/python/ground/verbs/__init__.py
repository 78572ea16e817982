"""The verbs of the command line, one module each.

A module has NAME, SUMMARY, configure(parser) and run(arguments); run returns what --json prints.
"""
from ground.verbs import add, compare, diagnose, fit, import_csv, info, simulate, thrust, tracking

ALL = [import_csv, info, thrust, simulate, fit, compare, diagnose, add, tracking]
