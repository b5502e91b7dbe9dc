"""Octree of the optical coefficients of a medium.

Division follows the paper (Section "Ray Tracing"): a cube is halved while the optical depth of its
vapour exceeds a bound or it contains droplets, until its edge is below the leaf edge. Leaves of one
finest cell are stored in bricks of 8^3 cells, so that kernels access them with two loads; a coarser
leaf is one value for all the bricks (or cells) that it covers.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.gpu.device import Device
from cldit.medium.deposit import Directory, Placed, place_boxes, place_droplets, touched_bricks
from cldit.medium.division import Division
from cldit.medium.frame import BRICK, CELLS_PER_BRICK, Cube
from cldit.spray.extent import Extent

_TOGETHER = 4  # trees that are filled at a time, one per thread
# Absorption below this optical depth across the whole cube is set to 0: it is far below rounding in
# any image, and its denormal numbers would slow down all kernels.
_NOTHING = 1e-12
_CLASS = "droplet_scattering_"  # and the number of a size class, while a tree is built

FIELDS = (
    "vapour_absorption",
    "vapour_emission",
    "droplet_absorption",
    "droplet_scattering",
    "droplet_emission",
)


@dataclass(frozen=True)
class PointSource:
    """Droplets in parcels: cross sections summed over a parcel's droplets, (N,) each.

    absorption_m2, scattering_m2: cross sections; emission_m2: absorption_m2 x photon radiance.
    extent: distribution of droplets about `position_m`; None: at this point.
    class_scattering_m2: scattering_m2 of each class of droplet size except the first, (N,) each;
        empty: one class.
    """

    position_m: Floats
    absorption_m2: Floats
    scattering_m2: Floats
    emission_m2: Floats
    extent: Extent | None = None
    class_scattering_m2: tuple[Floats, ...] = ()

    @property
    def sections(self) -> dict[str, Floats]:
        """Amounts (N,) to deposit in each field, m2 or emission times m2."""
        return {
            "droplet_absorption": self.absorption_m2,
            "droplet_scattering": self.scattering_m2,
            "droplet_emission": self.emission_m2,
            **{f"{_CLASS}{k}": section for k, section in enumerate(self.class_scattering_m2, 1)},
        }


@dataclass(frozen=True)
class CellSource:
    """Coefficients in boxes, per metre, (N,) each; emission = absorption x photon radiance."""

    lower_m: Floats
    upper_m: Floats
    vapour_absorption: Floats
    vapour_emission: Floats
    droplet_absorption: Floats
    droplet_scattering: Floats
    droplet_emission: Floats


Sources = tuple[PointSource | None, list[CellSource]]


@dataclass(frozen=True)
class Octree:
    """Flat arrays of a tree.

    directory: (nb, nb, nb) int32, [z, y, x]. d >= 0: the brick's cells are values[d * 512 + local],
        local = (z * 8 + y) * 8 + x. d < 0: the whole brick is in one coarse leaf, whose value is
        values[slots * 512 - 1 - d].
    coarse_level: level of every coarse leaf, so that a ray crosses it in one step. The first
        depth + 1 of them are empty space, one for each level.
    fields: one float32 array for each name in FIELDS, coefficients per metre, emission in
        photons s-1 m-3 sr-1.
    leaves: number of leaves of each level, 0 (the cube) to depth.
    shares: (K - 1, P) uint8, cumulative share of each of K classes of droplet size except the last
        in the scattering of all droplets, in 255ths; None: one class.
    """

    frame: Cube
    directory: NDArray[np.int32]
    slots: int
    coarse_level: NDArray[np.int32]
    fields: dict[str, NDArray[np.float32]]
    leaves: tuple[int, ...]
    shares: NDArray[np.uint8] | None = None

    @property
    def filled(self) -> Mask:
        """Mask (nb, nb, nb) of bricks that are not empty space."""
        return (self.directory >= 0) | (self.directory < -1 - self.frame.depth)

    @property
    def has_vapour(self) -> bool:
        """True if any vapour absorbs."""
        return bool(np.any(self.fields["vapour_absorption"] > 0))

    @property
    def has_droplets(self) -> bool:
        """True if any droplet absorbs or scatters."""
        absorbs = np.any(self.fields["droplet_absorption"] > 0)
        return bool(absorbs or np.any(self.fields["droplet_scattering"] > 0))

    def integral(self, name: str) -> float:
        """Field `name` integrated over the cube, m3 times the field's unit."""
        values = self.fields[name].astype(np.float64)
        fine = values[: self.slots * CELLS_PER_BRICK].sum() * self.frame.cell_m**3
        coarse = -1 - self.directory[self.directory < 0]
        side = min(BRICK, self.frame.cells) * self.frame.cell_m
        return float(fine + values[self.slots * CELLS_PER_BRICK + coarse].sum() * side**3)


def build_octree(
    frame: Cube,
    points: PointSource | None,
    cells: list[CellSource],
    *,
    optical_depth_split: float,
    max_cells: int = 60_000_000,
    device: Device | None = None,
) -> Octree:
    """Deposits droplets in `points` and gas in `cells`, and divides the cube.

    `optical_depth_split` is that above which a cube of vapour is halved. Clouds of droplets need a
    `device`. Raises MediumError if
    something is outside the cube, or if the tree has more than `max_cells` finest cells.
    """
    return build_octrees(
        frame,
        [(points, cells)],
        optical_depth_split=optical_depth_split,
        max_cells=max_cells,
        device=device,
    )[0]


def build_octrees(
    frame: Cube,
    sources: Sequence[Sources],
    *,
    optical_depth_split: float,
    max_cells: int = 60_000_000,
    device: Device | None,
) -> list[Octree]:
    """One tree for each of several sets of coefficients of the same spray (wavelengths).

    Positions are those of the first set. All trees have one division, by the largest coefficients,
    and so the same addresses; the geometry is computed once. Otherwise as `build_octree`.
    """
    droplets, boxes = placed_sources(frame, sources[0], device)
    touched = touched_bricks(frame, [*droplets, *boxes], limit=max_cells)
    deposited = _deposit(frame, touched, droplets, boxes, sources)
    for fields in deposited:
        faint = fields["vapour_absorption"] * frame.edge_m < _NOTHING
        fields["vapour_absorption"][faint] = 0.0
        fields["vapour_emission"][faint] = 0.0
    division = Division.of(frame, touched, deposited, optical_depth_split)
    if len(deposited) == 1:  # other threads do not reuse the memory of a thread
        return [_filled(division, deposited[0])]
    with ThreadPoolExecutor(_TOGETHER) as pool:
        return list(pool.map(lambda fields: _filled(division, fields), deposited))


def placed_sources(
    frame: Cube, sources: Sources, device: Device | None
) -> tuple[list[Placed], list[Placed]]:
    """Geometry of droplets (one or none) and of each source of gas in the cube.

    `device` is that of `place_droplets`. Raises MediumError if something is outside the cube.
    """
    points, cells = sources
    droplets: list[Placed] = []
    if points is not None:
        optical = points.absorption_m2 + points.scattering_m2
        place = points.position_m
        droplets.append(place_droplets(frame, place, points.extent, optical, device))
    boxes = [
        place_boxes(frame, source.lower_m, source.upper_m, content="gas", device=device)
        for source in cells
    ]
    return droplets, list(boxes)


def _deposit(
    frame: Cube,
    touched: Directory,
    droplets: list[Placed],
    boxes: Sequence[Placed],
    sources: Sequence[Sources],
) -> list[dict[str, Floats]]:
    size = int(np.count_nonzero(touched >= 0)) * CELLS_PER_BRICK
    deposited = [
        {name: np.zeros(size) for name in (*FIELDS, *({} if section is None else section.sections))}
        for section, _ in sources
    ]
    volume = frame.cell_m**3
    for placed in droplets:
        targets, amounts = [], []
        for fields, (points, _) in zip(deposited, sources, strict=True):
            if points is not None:
                targets += [fields[name] for name in points.sections]
                amounts += [section / volume for section in points.sections.values()]
        placed.add(touched, amounts, targets)
    for number, box in enumerate(boxes):
        place = sources[0][1][number]
        width, depth, height = ((place.upper_m - place.lower_m) / frame.cell_m).T
        in_cells = width * depth * height
        targets, amounts = [], []
        for fields, (_, cells) in zip(deposited, sources, strict=True):
            for name in FIELDS:
                values = getattr(cells[number], name)
                if np.any(values):
                    targets.append(fields[name])
                    amounts.append(values * in_cells)
        box.add(touched, amounts, targets)
    return deposited


def _filled(division: Division, fields: dict[str, Floats]) -> Octree:
    """The tree with one set of values."""
    values = {name: division.fill(data) for name, data in fields.items()}
    classes = [values.pop(name) for name in list(values) if name.startswith(_CLASS)]
    return Octree(
        frame=division.frame,
        directory=division.directory,
        slots=len(division.keep),
        coarse_level=division.coarse_level,
        fields=values,
        leaves=division.leaves,
        shares=_cumulative(values["droplet_scattering"], classes) if classes else None,
    )


def _cumulative(
    total: NDArray[np.float32], classes: list[NDArray[np.float32]]
) -> NDArray[np.uint8]:
    """Shares as in `Octree`, from the scattering (P,) of all classes and of each but the first."""
    above = np.cumsum(classes[::-1], axis=0)[::-1]  # of each class and the later ones
    share = np.divide(above, total, out=np.zeros_like(above), where=total > 0)
    return np.asarray(255 - np.rint(255 * np.clip(share, 0.0, 1.0))).astype(np.uint8)
