"""Models against recordings: errors, what is missing, evidence for it."""
