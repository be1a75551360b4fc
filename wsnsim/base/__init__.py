"""The shared vocabulary: requests, ports, setups, tables, metrics, random streams, errors. NumPy only."""
