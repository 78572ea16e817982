"""history: what drifts, what jumped and which craft is odd, over all runs of a laboratory."""
