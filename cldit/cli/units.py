"""Options that take a number with or without its unit."""

from __future__ import annotations

from typing import Any

import click


class Quantity(click.ParamType):
    """A number in one unit, which may be written behind it: `0.1`, `0.1K`, `"0.1 K"`."""

    def __init__(self, unit: str) -> None:
        self.name = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            return float(str(value).strip().removesuffix(self.name))
        except ValueError:
            self.fail(f"{value!r} is no number of {self.name}; allowed is e.g. 0.1{self.name}")


KELVIN = Quantity("K")
SECOND = Quantity("s")
