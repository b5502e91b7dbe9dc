"""How far a piece of work is, told to whoever watches it."""

from __future__ import annotations

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Takes what is in work, how much of it is done, and of how much."""


def silent(what: str, done: int, total: int) -> None:
    """Tells nobody.

    Args:
        what, done, total: as for any `Watch`.
    """
