"""Cramér-Rao bounds on the tracking error: posterior, and conditional on a trajectory."""
