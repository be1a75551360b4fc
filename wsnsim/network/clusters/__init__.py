"""Clusters: election, formation, handover, head protocols, the driver of tracker requests, and wake-up ahead."""
