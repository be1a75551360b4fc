"""The words everybody speaks. NumPy only."""
