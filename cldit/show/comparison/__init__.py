"""Two pictures side by side: their difference in kelvin, and whether stated errors explain it."""

from cldit.show.comparison.difference import Difference, MapDifference, compare
from cldit.show.comparison.shown import Shown, open_shown

__all__ = ["Difference", "MapDifference", "Shown", "compare", "open_shown"]
