"""Two pictures side by side: their difference in kelvin, and whether stated errors explain it."""

from cldit.comparison.difference import Difference, MapDifference, compare
from cldit.comparison.shown import Shown, open_shown

__all__ = ["Difference", "MapDifference", "Shown", "compare", "open_shown"]
