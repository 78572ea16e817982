"""The recordings that a verb works on: import and info, and how all verbs choose, read and repair them."""
