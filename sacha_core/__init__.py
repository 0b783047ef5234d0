"""SACHA: semantic-aware compression of animatable 3D Gaussian head avatars."""
