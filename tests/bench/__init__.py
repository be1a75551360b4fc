"""Measurements, as ratios within one run. Never part of the tests: a timed test fails on a busy machine."""
