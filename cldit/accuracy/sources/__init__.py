"""Sources of error; a new one is a class or a row here and an entry of `SOURCES`."""

from collections.abc import Mapping

from cldit.accuracy.sources.base import ErrorSource
from cldit.accuracy.sources.discretisation import CELLS, ORDINATES, WAVELENGTHS
from cldit.accuracy.sources.gas_grid import GAS_GRID
from cldit.accuracy.sources.omissions import CUTOFF, GATHER, ORDERS, VAPOUR_CELLS
from cldit.accuracy.sources.parcels import PARCELS, SIZE_CLASSES
from cldit.accuracy.sources.pixel_sampling import PIXEL_SAMPLING

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
BY_NAME: Mapping[str, ErrorSource] = {source.name: source for source in SOURCES}
