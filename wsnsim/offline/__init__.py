"""A tracker without a network: every sensor at one table, every packet arrives, nothing takes time or energy."""
