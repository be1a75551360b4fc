"""TSCH: slots, channel hopping, cells that heads give their members, and synchronisation."""
