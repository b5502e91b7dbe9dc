"""How the equation of transfer is to be solved."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Tag

from cldit.scene.checks import Section, Within


class HenyeyGreenstein(Section):
    """A phase function by its mean cosine."""

    henyey_greenstein: Annotated[float, Within(-0.999, 0.999)]
    """Mean cosine g of the scattering angle."""


def _kind(value: object) -> str | None:
    """Tag of the type in `Phase` that checks a value; None: the value is no phase function."""
    if value in ("isotropic", "mie"):
        return "name"
    return "HenyeyGreenstein" if isinstance(value, (dict, HenyeyGreenstein)) else None


Phase = Annotated[
    Annotated[Literal["isotropic", "mie"], Tag("name")]
    | Annotated[HenyeyGreenstein, Tag("HenyeyGreenstein")],
    Discriminator(
        _kind,
        custom_error_type="not_allowed",
        custom_error_message=(
            "is no phase function; allowed: isotropic, mie, {henyey_greenstein: g}"
        ),
    ),
]


class Transport(Section):
    """How the equation of transfer is solved."""

    method: Literal["source", "path", "branching"] = "source"
    """`source`: sweeps through the cells to a residual; `path`: unbiased paths; `branching`: the
    paper's."""
    order: Annotated[int, Within(0, 1000)] | None = None
    """Scatterings that are followed, beyond them the wall is seen; left out: all."""
    accuracy_K: Annotated[float, Within(1e-4, 100.0)] = 1.0
    """Wanted error of the picture's apparent temperature, RMS over the pixels that have one, of all
    causes of the simulation together. With `audit: false`: of the trace alone."""
    max_samples: Annotated[int, Within(128, 10_000_000)] = 4096
    """Of `path`, and of what `source` gathers, a pixel."""
    phase: Phase | None = None
    """Left out: isotropic with the preset `paper`, mie with `spectral` (isotropic where droplets
    are given as coefficients, or the method is `branching`)."""
    gather: bool = True
    """`source`: light changes within cells; what thick ones scatter is followed, within
    them and from cell to cell."""
    audit: bool = True
    """Trace some pixels by `path` as well, and the medium on larger cells and with half of the
    parcels, to know the picture's error by cause, and to choose what is left out from it."""
    cutoff: Annotated[float, Within(0.0, 0.5)] = 1e-4
    """Transmission at which a ray ends."""
    directions: Annotated[int, Within(4, 4096)] | None = None
    """Of the sweeps; left out: chosen from what `accuracy_K` leaves for the trace."""
    precision: Literal["auto", "float32", "float64"] = "auto"
    """`auto`: float32 where it is enough."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Of `path` and `branching`."""
