"""Pure functions of arrays: quaternions, triangle frames, spherical harmonics, skinning."""
