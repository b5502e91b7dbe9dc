"""Comparison of two results: their difference in kelvin, beside the stated errors."""

from cldit.show.comparison.difference import Difference, MapDifference, compare
from cldit.show.comparison.shown import Shown, open_shown

__all__ = ["Difference", "MapDifference", "Shown", "compare", "open_shown"]
