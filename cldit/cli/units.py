"""What options of several commands take: a number with or without its unit; a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    _Float = click.ParamType[float]
    Text = click.ParamType[str]
else:
    _Float = Text = click.ParamType  # generic from click 8.5 on


class Quantity(_Float):
    """A number in one unit, which may be written behind it: `0.1`, `0.1K`, `"0.1 K"`."""

    def __init__(self, unit: str) -> None:
        self.name = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number in `value`, with or without its unit; `param` and `ctx` are click's."""
        try:
            return float(str(value).strip().removesuffix(self.name))
        except ValueError:
            self.fail(f"{value!r} is no number of {self.name}; allowed is e.g. 0.1{self.name}")


KELVIN = Quantity("K")
device_option = click.option(
    "--device", help="OpenCL device: platform:device, or part of its name."
)
