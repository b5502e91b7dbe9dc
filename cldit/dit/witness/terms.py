"""The drift terms of the fit in kelvin of the black body, for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.dit.solve import Drift
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.trend import unit

Floats = NDArray[np.float64]

_NAMES = {
    "black body": "black body",
    "offset": "offset of the camera",
    "gain": "gain of the camera",
}


@dataclass(frozen=True, kw_only=True)
class DriftTerm:
    """One term of the covariance that references and injections share.

    name: cause and kind. setpoints, kelvin: by background; a steady drift has its sign, the others
    are standard deviations.
    """

    name: str
    setpoints: tuple[float, ...]
    kelvin: tuple[float, ...]

    def to_dict(self) -> dict[str, object]:
        """All of it."""
        return asdict(self)


def terms(
    evidence: Evidence, *, given: Sequence[Drift], found: Sequence[Drift]
) -> tuple[DriftTerm, ...]:
    """Every term that is not 0.

    Args:
        evidence: of K backgrounds.
        given: stated by the user, or by the black body's readings.
        found: from the references.

    Returns:
        Those that are given, then those found.
    """
    listed: list[tuple[str, Floats]] = []
    for origin, drifts in (("stated, or by readings", given), ("found", found)):
        for one in drifts:
            per_kelvin = unit(evidence, one.cause) / evidence.rise
            name = _NAMES[one.cause]
            listed += [
                (f"{name}, steady drift", one.course * per_kelvin),
                (f"{name}, before each background ({origin})", np.sqrt(one.variance) * per_kelvin),
            ]
    return tuple(
        DriftTerm(name=name, setpoints=evidence.setpoints, kelvin=tuple(kelvin.tolist()))
        for name, kelvin in listed
        if kelvin.any()
    )
