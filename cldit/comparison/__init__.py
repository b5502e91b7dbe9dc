"""Comparison of results: measured, simulated and ensembles, with the errors that they do not share.

`shown.py` opens a result as maps with their position and errors. `shared.py` removes the errors
that two of them have in common. `pixels.py` brings both onto the same pixels, `registration.py`
into one view. `difference.py` subtracts them; `tested.py` tests the difference by region,
`members.py` injections on both sides. `causes.py` finds what explains it, `verdict.py` puts it into
words. `compare.py` does so for several, with systematic errors of simulations.

`rivals.py` and `unknowns.py` prepare two models, and what is not known of them, for a plan.
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
