"""Sixteen pixels at a time of images whose rows are of any width."""

from __future__ import annotations

from sacha_core.parallel.kernels.lanes import LANES, inlined, load, load_first, store, store_first


@inlined
def pixels(image, image_at, target, target_at, unit, count):
    """Give sixteen pixels of image and target, of which `count` are inside; zero beyond."""
    if count >= LANES:
        return load(image, image_at), load(target, target_at) * unit
    return load_first(image, image_at, count), load_first(target, target_at, count) * unit


@inlined
def write(gradient, at, count, value):
    """Write the first `count` of sixteen numbers, or all where there are more."""
    if count >= LANES:
        store(gradient, at, value)
    else:
        store_first(gradient, at, count, value)
