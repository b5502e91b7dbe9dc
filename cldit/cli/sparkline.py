"""Numbers as one line of characters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

_BLOCKS = " ▁▂▃▄▅▆▇█"
_ROUNDING = 1e-9
_ASCII = " .:-=+*#@"  # for terminals that have no blocks


def sparkline(values: Sequence[float], *, encoding: str, columns: int) -> str:
    """`values` from 0 up, each a character; what is above 0 is never blank.

    Args:
        values: none below 0.
        encoding: of the terminal.
        columns: at most; of more values, the largest of each share is shown.
    """
    if not len(values):
        return ""
    levels = _BLOCKS if encoding.lower().startswith("utf") else _ASCII
    columns = max(min(columns, len(values)), 1)
    edges = [number * len(values) // columns for number in range(columns + 1)]
    shown = [max(values[a:b]) for a, b in pairwise(edges)]
    most = max(shown) or 1.0
    steps = len(levels) - 1
    return "".join(levels[math.ceil(steps * value / most - _ROUNDING)] for value in shown)
