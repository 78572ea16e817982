"""Models against recordings: errors, missing effects and the evidence for them."""
