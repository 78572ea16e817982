"""Simulated experiments, controllers in closed loop, and the search for their gains."""
