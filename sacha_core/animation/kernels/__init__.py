"""Numba kernels of this package."""
