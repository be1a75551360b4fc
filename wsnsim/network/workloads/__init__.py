"""Workloads: networks without targets, and what their nodes do."""
