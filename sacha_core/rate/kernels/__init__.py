"""Sums over Gaussians, compiled."""
