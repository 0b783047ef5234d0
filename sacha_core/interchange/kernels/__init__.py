"""Compiled loops of this package."""
