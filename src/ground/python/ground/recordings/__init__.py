"""Recordings: bags read, repaired, judged and cut into windows."""
