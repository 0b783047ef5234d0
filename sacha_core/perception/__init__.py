"""What people see: the reference sensitivity map, and image metrics."""
