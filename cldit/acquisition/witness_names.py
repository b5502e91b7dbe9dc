"""Names of the evaluation's witnesses, by which a measurement accepts their findings."""

from typing import Literal, get_args

Acceptable = Literal[
    "backgrounds",
    "injections",
    "kinds",
    "pixels",
    "levels",
    "shift",
    "repeats",
    "saturation",
    "orientation",
    "celsius",
]
ACCEPTABLE: tuple[str, ...] = get_args(Acceptable)
