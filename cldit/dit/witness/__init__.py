"""Witnesses: checks of a measurement by its own recorded shots."""
