"""Mean Mie phase functions of a spray's droplets, kept by content."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cldit.io.tables import Arrays, cached, digest
from cldit.medium.octree import PointSource
from cldit.optics.band import BandOptics
from cldit.optics.scene_phase import has_coefficients
from cldit.spray.result import Spray
from cldit.transport.mie_phase import SizeBins
from cldit.transport.phase import PhaseError, ScatteringTable
from cldit.transport.size_classes import MOST_CLASSES, TOLERATED, in_size_classes

_FORM = 2  # version of kept phase functions


def droplets_content(spray: Spray) -> str:
    """Digest of all of a spray's droplets."""
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
    """The droplets' mean phase function in one band; None if none scatters.

    It has classes of size where one mean does not hold for all places. `points` are the droplets in
    this band, from `emitters`; `content` is their digest, by which the result is kept in `cache`.
    """
    if has_coefficients(spray):
        raise PhaseError(
            "transport.phase: mie needs droplet diameters, and this spray gives coefficients only; "
            "allowed: isotropic, or the g of Henyey and Greenstein"
        )
    if points is None or spray.parcels is None or band.droplets is None:
        return None
    if not points.scattering_m2.any():
        return None
    parcels, section = spray.parcels, points.scattering_m2
    table = band.droplets.tables[len(band.droplets.tables) // 2]
    indices = [(entry.wavelength_um, entry.n, entry.k) for entry in band.droplets.tables]
    arrays = cached(
        cache,
        kind="scattering",
        description=f"{_FORM} {indices!r} {band.droplets.temperature_K.tolist()!r} {content}",
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
    """Remark that the classes of size do not resolve how the phase function varies, or nothing."""
    classes = [phase.classes for phase in phases if phase is not None]
    unresolved = [sizes.unresolved for sizes in classes if sizes is not None]
    difference = max(unresolved, default=0.0)
    if difference <= TOLERATED:
        return ()
    return (
        f"phase functions: {MOST_CLASSES} classes of droplet size leave a difference of "
        f"{difference:.2g} between places, more than {TOLERATED:g}, or some 0.1 K of T_app, which "
        "no stated error contains",
    )


def in_classes(
    points: PointSource | None, spray: Spray, phase: ScatteringTable | None
) -> PointSource | None:
    """Droplets of a spray with the scattering of each class of size, if the phase has classes."""
    if points is None or spray.parcels is None or phase is None or phase.classes is None:
        return points
    number = phase.classes.number(spray.parcels.diameter_m)
    above = range(1, len(phase.classes.tables))
    return replace(
        points,
        class_scattering_m2=tuple(np.where(number == k, points.scattering_m2, 0.0) for k in above),
    )
