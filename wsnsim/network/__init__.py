"""Everything that happens in simulated time. SimPy and networkx live here."""
