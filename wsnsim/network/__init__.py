"""Everything that happens in simulated time: nodes, radio, clusters, sensing, faults, clocks. SimPy lives here."""
