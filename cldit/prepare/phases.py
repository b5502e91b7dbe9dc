"""How the droplets of a scene scatter: by its phase function, or by what its preset means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from cldit.io.tables import Arrays, cached, digest
from cldit.medium.octree import PointSource
from cldit.optics.band import BandOptics
from cldit.scene import Scene
from cldit.scene.transport import HenyeyGreenstein
from cldit.spray.result import Spray
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import PhaseError, ScatteringTable
from cldit.transport.size_classes import MOST_CLASSES, TOLERATED, in_size_classes

_FORM = 2  # of kept phase functions


@dataclass(frozen=True)
class PhaseChoice:
    """How droplets scatter: by Mie's phase function or not, in words, and what one should know."""

    mie: bool
    words: str
    remarks: tuple[str, ...] = ()


def phase_choice(scene: Scene, spray: Spray, preset: Literal["paper", "spectral"]) -> PhaseChoice:
    """What the scene says, or what its preset means where it says nothing.

    Args:
        scene: what is to be traced.
        spray: that of the scene.
        preset: of the optics.
    """
    given = scene.transport.phase
    if isinstance(given, HenyeyGreenstein):
        return PhaseChoice(False, f"Henyey and Greenstein, g {given.henyey_greenstein:g}")
    if given is not None:
        return PhaseChoice(given == "mie", given)
    if preset == "paper":
        return PhaseChoice(False, "isotropic (preset paper)")
    if _coefficients(spray):
        remark = (
            "droplets given as coefficients, without diameters, are taken to scatter "
            "isotropically; set transport.phase: {henyey_greenstein: g} if g is known"
        )
        return PhaseChoice(False, "isotropic (no diameters)", (remark,))
    if scene.transport.method == "branching":
        remark = "method branching scatters isotropically, whatever the preset"
        return PhaseChoice(False, "isotropic (method branching)", (remark,))
    return PhaseChoice(True, "mie (preset spectral)")


def _coefficients(spray: Spray) -> bool:
    given = spray.prescribed
    return given is not None and bool(np.any(given.droplet_scattering_per_m > 0))


def droplets_content(spray: Spray) -> str:
    """A short text that stands for all of a spray's droplets."""
    if spray.parcels is None:
        return ""
    parcels = spray.parcels
    return digest(parcels.diameter_m, parcels.droplets, parcels.temperature_K)


def mean_phase(
    spray: Spray,
    band: BandOptics,
    points: PointSource | None,
    *,
    content: str,
    cache: Path | None,
) -> ScatteringTable | None:
    """The droplets' mean phase function in one band, and those of classes of size where one mean
    does not hold for all places; None where none scatters.

    Args:
        spray: whose droplets scatter.
        band: optical properties in the band.
        points: what `emitters` made of the droplets in this band.
        content: digest of the droplets, `droplets_content`, by which it is kept.
        cache: folder in which it is kept; None keeps nothing.

    Raises:
        PhaseError: droplets are given as coefficients, without diameters.
    """
    if _coefficients(spray):
        raise PhaseError(
            "transport.phase: mie needs droplet diameters, and this spray gives coefficients only; "
            "allowed: isotropic, {henyey_greenstein: g}"
        )
    if points is None or spray.parcels is None or band.droplets is None:
        return None
    if not points.scattering_m2.any():
        return None
    parcels, section = spray.parcels, points.scattering_m2
    table = band.droplets.tables[len(band.droplets.tables) // 2]
    indices = [(one.wavelength_um, one.n, one.k) for one in band.droplets.tables]
    arrays = cached(
        cache,
        kind="scattering",
        text=f"{_FORM} {indices!r} {band.droplets.temperature_K.tolist()!r} {content}",
        make=lambda: _plain(
            SizeBins.of(
                parcels.diameter_m,
                section,
                wavelength_um=table.wavelength_um,
                n=table.n,
                k=table.k,
            )
        ),
    )
    bins = SizeBins(arrays["edges_m"], arrays["share"], arrays["within"])
    return in_size_classes(
        bins.mean(),
        bins,
        position_m=parcels.position_m,
        diameter_m=parcels.diameter_m,
        scattering_m2=section,
        sampled=parcels.sampled,
    )


def _plain(bins: SizeBins) -> Arrays:
    return {"edges_m": bins.edges_m, "share": bins.share, "within": bins.within}


def sizes_left(phases: Sequence[ScatteringTable | None]) -> tuple[str, ...]:
    """That the most classes of size do not tell the places of a spray apart.

    Args:
        phases: of each wavelength.
    """
    classes = [phase.classes for phase in phases if phase is not None]
    left = max((one.left for one in classes if one is not None), default=0.0)
    if left <= TOLERATED:
        return ()
    return (
        f"phase functions: {MOST_CLASSES} classes of droplet size leave places {left:.2g} apart, "
        f"more than {TOLERATED:g}, which is some 0.1 K of T_app; this is in no stated error",
    )


def in_classes(
    points: PointSource | None, spray: Spray, phase: ScatteringTable | None
) -> PointSource | None:
    """Droplets with what each class of size scatters, where their phase function has classes.

    Args:
        points: the droplets of `spray`.
        spray: whose diameters tell the class.
        phase: of `mean_phase`.
    """
    if points is None or spray.parcels is None or phase is None or phase.classes is None:
        return points
    number = phase.classes.number(spray.parcels.diameter_m)
    above = range(1, len(phase.classes.tables))
    return replace(
        points,
        class_scattering_m2=tuple(np.where(number == k, points.scattering_m2, 0.0) for k in above),
    )
