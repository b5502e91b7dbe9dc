"""How the equation of transfer is to be solved."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Tag

from cldit.scene.checks import Section, Within


def _parametric(value: object) -> str | None:
    return "HenyeyGreenstein" if isinstance(value, (dict, HenyeyGreenstein)) else None


class HenyeyGreenstein(Section):
    """A phase function by its mean cosine."""

    henyey_greenstein: Annotated[float, Within(-0.999, 0.999)]


Phase = Annotated[
    Annotated[Literal["isotropic", "mie"], Tag("name")]
    | Annotated[HenyeyGreenstein, Tag("HenyeyGreenstein")],
    Discriminator(
        lambda value: "name" if value in ("isotropic", "mie") else _parametric(value),
        custom_error_type="not_allowed",
        custom_error_message=(
            "is no phase function; allowed: isotropic, mie, {henyey_greenstein: g}"
        ),
    ),
]


class Transport(Section):
    """How the equation of transfer is solved."""

    method: Literal["source", "path", "branching"] = "source"
    order: Annotated[int, Within(0, 1000)] | None = None  # None: all; beyond it the wall is seen
    accuracy_K: Annotated[float, Within(1e-4, 100.0)] = 0.1
    max_samples: Annotated[int, Within(128, 10_000_000)] = 4096  # of `path`, a pixel
    # None: as optics.preset has it, isotropic with `paper`, mie with `spectral` (isotropic where
    # droplets are given as coefficients, or the method is `branching`)
    phase: Phase | None = None
    gather: bool = False  # `source`: follow what thick cells scatter, from cell to cell
    cutoff: Annotated[float, Within(0.0, 0.5)] = 1e-4
    directions: Annotated[int, Within(4, 4096)] | None = None  # None: chosen from accuracy_K
    precision: Literal["auto", "float32", "float64"] = "auto"
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
