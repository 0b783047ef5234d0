"""How many Gaussians a region gets: sensitivity, modulators, importance scores, selection."""
