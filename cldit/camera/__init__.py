"""Lens, filter, sensor and noise: radiance to electrons to counts."""
