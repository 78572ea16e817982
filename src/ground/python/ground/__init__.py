"""Identification of a miniature hovercraft: recordings, fits and comparisons."""
