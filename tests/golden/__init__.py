"""Stored fingerprints of every shipped scenario, and the comparison of today's runs with them: see `__main__`."""
