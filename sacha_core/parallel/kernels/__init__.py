"""Vectors of sixteen lanes, for the kernels of other packages."""
