"""Memory that a case needs, estimated from counts before anything large is read."""

from dataclasses import dataclass
from pathlib import Path

from cldit.errors import SprayError
from cldit.io.free_memory import free_bytes

# Measured with `python -m tests.bench imports`: bytes in addition to the reader's.
_ROW = 160  # of a parcel or cell: ten doubles, twice while they are put together
WHILE_READING = {"xml": 1.4, "hdf": 2.0}  # that vtk takes at its peak for one that is stored
_ANYWAY = 200e6  # for some cells at a time, whatever the case


@dataclass(frozen=True)
class Size:
    """Counts of a case, and the bytes that its reader needs for mesh and fields at its peak."""

    cells: int
    parcels: int
    held_bytes: float

    @property
    def need_bytes(self) -> float:
        """Memory that the import takes at its peak."""
        return self.held_bytes + _ROW * (self.cells + self.parcels) + _ANYWAY


def check_room(source: Path, size: Size) -> None:
    """Refuses a case that needs more memory than is free; `source` names it."""
    free = free_bytes()
    if free is None or size.need_bytes <= free:
        return
    parcels = f" and {size.parcels} parcels" if size.parcels else ""
    raise SprayError(
        f"{source}: about {size.cells} cells{parcels} need some {size.need_bytes / 1e9:.2g} GB of "
        f"memory; {free / 1e9:.2g} GB are free. Close other programs; or export only the region "
        "around the spray (a clip or threshold on the fuel in ParaView); or run `cldit import CASE "
        "--out spray.npz` on a larger machine, and use spray.npz instead of the case"
    )
