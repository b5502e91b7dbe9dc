"""Lens, filter, sensor, noise: radiance -> electrons -> counts."""
