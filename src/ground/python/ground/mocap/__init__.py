"""Poses from motion capture systems, while they stream."""
