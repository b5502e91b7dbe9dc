"""Witnesses: what recorded shots say about the measurement itself."""
