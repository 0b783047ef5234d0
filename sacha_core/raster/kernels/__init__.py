"""Numba kernels of the rasteriser: serial, over ranges, without Python's lock."""
