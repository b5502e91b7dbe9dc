"""The equation of transfer: weights per pixel."""
