"""Callbacks for the progress of a piece of work."""

from collections.abc import Callable

Watch = Callable[[str, int, int], None]
"""Takes the name of the work, the number of parts done, and of all parts."""


def silent(work: str, done: int, total: int) -> None:
    """Ignores the progress of `work`: `done` of `total` parts."""
