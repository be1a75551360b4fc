"""Functions that several trackers share: parcels, readings, stacked clouds, swarm moves, moments, dealing."""
