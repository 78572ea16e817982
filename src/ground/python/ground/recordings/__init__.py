"""Recordings: reading bags, repairing and checking them, and cutting them into windows."""
