"""A page of our own: error against joules, of every tracker on one field."""
