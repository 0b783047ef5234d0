"""Training on a CUDA device: the engine whose rasteriser is gsplat."""
