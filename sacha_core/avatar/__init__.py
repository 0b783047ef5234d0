"""What is compressed: canonical Gaussians, their binding to a head, and motion."""
