"""Numerical kernels, compiled with Numba: arrays in, arrays out. Each has a plain counterpart under tests/kernels."""
