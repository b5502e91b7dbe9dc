"""Figures, reports, and pages in the browser."""
