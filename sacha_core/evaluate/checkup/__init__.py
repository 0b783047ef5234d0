"""What a capture's tracking is worth, looked at before hours go into training on it."""
