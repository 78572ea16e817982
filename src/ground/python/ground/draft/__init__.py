"""Drafts: what the columns of a file seem to be, written as a mapping."""
