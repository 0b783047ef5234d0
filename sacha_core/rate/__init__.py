"""Encoding by rendering: what numbers are worth to pictures, and files of a wanted size or quality."""
