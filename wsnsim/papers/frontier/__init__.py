"""A comparison of our own: error against energy of every tracker on one field."""
