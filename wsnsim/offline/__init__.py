"""A tracker without a network: one cluster of all sensors, every packet arrives, nothing takes time or energy."""
