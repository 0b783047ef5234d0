"""Avatars in motion: posing and carrying Gaussians along frame after frame, and playing `.sacha` files."""
