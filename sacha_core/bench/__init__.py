"""Benchmarks: what each part of SACHA costs, and how far from the exact answer that leaves it."""
