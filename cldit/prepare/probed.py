"""The medium, and the variants of it, on which the error of the picture is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cldit.medium.frame import Frame
from cldit.medium.octree import Sources
from cldit.optics.spectral import SpectralNode
from cldit.prepare.gas_grid import GasGrid
from cldit.scene.spray import ConeSpray


@dataclass(frozen=True)
class ParcelVariants:
    """Sources of one wavelength in which the parcels differ; see `cldit.medium.cloud.Variants`.

    sampling: error by sampling over the halves' difference.
    """

    halves: tuple[Sources, Sources]
    narrower: Sources | None
    sampling: float


@dataclass(frozen=True)
class Probed:
    """What the causes of the medium are measured on.

    frame: the cube, divided as the scene has it; on_lattice: whose cells are the cone's lattice, so
    that another cone goes with other cells. limit: cells that fit the memory. sources: at the
    wavelength of `node`, its `number`. parcels: None where the droplets are no sample. gas: the
    spray on other cells of gas; None: there is no gas, or its cells are the cone's. cone: the cone,
    where the spray is one; resprayed: the sources of another.
    """

    frame: Frame
    sources: Sources
    number: int
    node: SpectralNode
    parcels: ParcelVariants | None
    gas: GasGrid | None
    optical_depth_split: float
    limit: int
    on_lattice: bool
    cone: ConeSpray | None
    resprayed: Callable[[ConeSpray], Sources]
