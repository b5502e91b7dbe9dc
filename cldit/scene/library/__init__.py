"""Scenes that are shipped by name."""
