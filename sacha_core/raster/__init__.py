"""Drawing Gaussians on the CPU: camera, rasteriser, and its gradient; numpy in, numpy out."""
