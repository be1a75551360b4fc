"""Everything that happens in simulated time. SimPy lives here."""
