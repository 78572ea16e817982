#!/usr/bin/python3
"""Counts which tests execute which lines: count.py core|python JOBS [NAME...]. NAME: only these files of
tests in Python. For the core, gcovr has to be asked next."""
import importlib
import sys

if __name__ == "__main__":
    side, jobs, *only = sys.argv[1:]
    module = importlib.import_module({"core": "core", "python": "package"}[side])
    module.count(int(jobs), *([only] if only else []))
