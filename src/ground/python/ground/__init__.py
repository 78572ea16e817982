"""Identification of a miniature hovercraft: recordings, fits and comparisons."""
import os

# Ceres logs steps that it takes back; what matters is in its summary, which errors quote.
os.environ.setdefault("GLOG_minloglevel", "3")
