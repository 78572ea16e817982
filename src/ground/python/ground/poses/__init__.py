"""Poses: their clock, noise, repair and velocities."""
