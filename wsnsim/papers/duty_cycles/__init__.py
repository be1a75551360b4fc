"""A comparison of our own: what trackers cost where radios are off most of the time."""
