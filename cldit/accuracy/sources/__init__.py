"""Sources of error, one file each; a new source is a file here and an entry of `SOURCES`."""

from collections.abc import Mapping

from cldit.accuracy.sources.base import ErrorSource
from cldit.accuracy.sources.cells import CELLS
from cldit.accuracy.sources.gas_grid import GAS_GRID
from cldit.accuracy.sources.omissions import CUTOFF, GATHER, ORDERS, VAPOUR_CELLS
from cldit.accuracy.sources.ordinates import ORDINATES
from cldit.accuracy.sources.parcels import PARCELS
from cldit.accuracy.sources.pixel_sampling import PIXEL_SAMPLING
from cldit.accuracy.sources.size_classes import SIZE_CLASSES
from cldit.accuracy.sources.wavelengths import WAVELENGTHS

SOURCES: tuple[ErrorSource, ...] = (
    ORDINATES,
    WAVELENGTHS,
    CELLS,
    PIXEL_SAMPLING,
    PARCELS,
    GAS_GRID,
    SIZE_CLASSES,
    ORDERS,
    CUTOFF,
    GATHER,
    VAPOUR_CELLS,
)
BY_NAME: Mapping[str, ErrorSource] = {one.name: one for one in SOURCES}
