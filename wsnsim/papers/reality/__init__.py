"""A comparison of our own: trackers on recorded readings, and on simulated ones of the same tracks."""
