"""The verbs of the command line, one module each.

A module has NAME, SUMMARY, configure(parser) and run(arguments); run returns what --json prints.
"""
from ground.verbs import add, bench, compare, diagnose, fit, import_csv, info, simulate, tracking

ALL = [import_csv, info, bench, simulate, fit, compare, diagnose, add, tracking]
