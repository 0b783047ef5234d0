"""Judging an avatar: splits, metrics, rate and distortion, reports."""
