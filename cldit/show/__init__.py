"""Figures, reports, pages in the browser, and comparisons of runs."""
