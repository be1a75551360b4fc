"""Arrays in, arrays out. Numba lives here; every kernel has a plain twin under tests/kernels."""
