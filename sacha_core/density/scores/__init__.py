"""How much each Gaussian matters to the pictures: one score a file."""
