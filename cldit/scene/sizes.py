"""Droplet size distributions of a scene."""

from itertools import pairwise
from typing import Annotated

from pydantic import Discriminator, Tag, model_validator

from cldit.scene.checks import Section, Within


class NukiyamaTanasawa(Section):
    """Nukiyama-Tanasawa distribution, f(D) ~ D^p exp(-(D/m)^n), paper Eq. (5)."""

    m_um: Annotated[float, Within(1e-3, 1e3)] = 1.5
    """Scale parameter m."""
    n: Annotated[float, Within(0.05, 20.0)] = 1.0
    """Exponent n."""
    p: Annotated[float, Within(-0.9, 50.0)] = 3.0
    """Exponent p."""


class Monodisperse(Section):
    """Droplets of one size at the nozzle."""

    diameter_um: Annotated[float, Within(1e-2, 5e3)]
    """Diameter of every droplet."""


class LogNormal(Section):
    """Log-normal distribution of the number of droplets over the diameter."""

    median_um: Annotated[float, Within(1e-3, 1e3)]
    """Median diameter by number."""
    sigma: Annotated[float, Within(1.001, 10.0)]
    """Geometric standard deviation."""


class RosinRammler(Section):
    """Rosin-Rammler distribution: the mass fraction in droplets above D is exp(-(D/d)^q)."""

    d_um: Annotated[float, Within(1e-3, 1e3)]
    """Scale parameter d; 37 % of the mass is in larger droplets."""
    q: Annotated[float, Within(1.01, 20.0)]
    """Exponent q; must exceed 1, where D32 vanishes."""


class Histogram(Section):
    """Numbers of droplets in bins of diameter, uniform within each bin."""

    edges_um: tuple[Annotated[float, Within(0.0, 1e4)], ...]
    """Rising edges of the bins, one more than `number`."""
    number: tuple[Annotated[float, Within(0.0, 1e30)], ...]
    """Relative number of droplets in each bin."""

    @model_validator(mode="after")
    def _fits(self) -> "Histogram":
        if len(self.edges_um) != len(self.number) + 1 or not 1 <= len(self.number) <= 1000:
            raise ValueError(
                f"number: {len(self.number)} values for {len(self.edges_um)} edges; allowed: "
                "1..1000 values, one less than edges_um"
            )
        if any(low >= high for low, high in pairwise(self.edges_um)):
            raise ValueError("edges_um: must rise")
        if not any(self.number):
            raise ValueError("number: all bins are empty")
        return self


_KINDS: dict[str, type[Section]] = {  # by a key that only one of them has
    "diameter_um": Monodisperse,
    "median_um": LogNormal,
    "d_um": RosinRammler,
    "edges_um": Histogram,
}


def _distribution(value: object) -> str | None:
    """Name of the distribution that has the given keys."""
    for key, kind in _KINDS.items():
        if isinstance(value, kind) or (isinstance(value, dict) and key in value):
            return kind.__name__
    return "NukiyamaTanasawa" if isinstance(value, (dict, NukiyamaTanasawa)) else None


Droplets = Annotated[
    Annotated[NukiyamaTanasawa, Tag("NukiyamaTanasawa")]
    | Annotated[Monodisperse, Tag("Monodisperse")]
    | Annotated[LogNormal, Tag("LogNormal")]
    | Annotated[RosinRammler, Tag("RosinRammler")]
    | Annotated[Histogram, Tag("Histogram")],
    Discriminator(
        _distribution,
        custom_error_type="not_allowed",
        custom_error_message=(
            "is no size distribution; allowed: {m_um, n, p}, {diameter_um}, {median_um, sigma}, "
            "{d_um, q}, {edges_um, number} or null"
        ),
    ),
]
