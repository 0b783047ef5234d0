"""Ablation: variants by seeds by captures, each trained, coded at several levels and judged, with every run's result in a file."""
