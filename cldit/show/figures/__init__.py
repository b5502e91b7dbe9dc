"""Figures of runs, sprays, optics and evaluations."""
