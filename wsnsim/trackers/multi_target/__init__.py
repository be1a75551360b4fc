"""Trackers of several targets in one head, from scans whose detections have no names.

tracker.step(belief, time, scans, nodes, facts, number) -> ScanOutcome        a pure function: no network, no randomness
"""
