"""Weights x sources -> radiance per pixel."""
