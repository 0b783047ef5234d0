"""Inner loops of the codec; the same source runs as plain Python and, where Numba is installed, compiled."""
