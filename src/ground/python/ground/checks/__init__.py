"""Checks: what looks wrong in recordings, with evidence and remedy."""
