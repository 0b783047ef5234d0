"""Training on a CUDA device: torch for posing, losses and Adam, gsplat for drawing. Nothing else in SACHA imports either to train."""
