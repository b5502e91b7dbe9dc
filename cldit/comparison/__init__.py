"""Comparison of results: measured, simulated and ensembles, with the errors that they do not share.

`shown.py` opens a result as maps with their position and errors. `shared.py` removes the errors
that two of them have in common, `lines.py` adds systematic errors of simulations. `pixels.py`
brings both onto the same pixels, and `registration.py` finds the view from the images.
`difference.py` subtracts them, by region (`regions.py`), and tests the difference
(`chi_square.py`). `compare.py` does so for several, and refuses what has no meaning; `shape.py`
measures penetration and areas, `keys.py` lists the keys that differ.
"""

from cldit.comparison.compare import Comparison, compare
from cldit.comparison.difference import Difference, MapDifference, difference
from cldit.comparison.shown import Shown, open_shown

__all__ = [
    "Comparison",
    "Difference",
    "MapDifference",
    "Shown",
    "compare",
    "difference",
    "open_shown",
]
