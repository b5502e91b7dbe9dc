"""Device arrays of the swept box in one order of axes, for discrete ordinates sweeps."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import upload, zeros
from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells, SweptBox
from cldit.transport.discrete_ordinates.cell_packets import PACKET, CellPackets, turned_too

Real = type[np.float32] | type[np.float64]


@dataclass(frozen=True)
class SweepArrays:
    """Cell packets of the box in one order of axes, and device arrays of them.

    turned: packets along y. rows, begins: packets of rows, and their cells, see kernels/sweep.cl.
    place: places of the N scattering cells among the cells of all packets.
    depth: optical depth of the cells' edges.
    thermal: thermal sources, [emitter][cell].
    gradient_place: places of the linear cells among the cells of packets that have any.
    gradient: spatial gradient of the source in these; x, y and z are `linear_size` numbers each.
    """

    packets: CellPackets
    turned: bool
    rows: Any
    begins: Any
    place: Any
    depth: Any
    thermal: Any
    gradient_place: Any
    gradient: Any
    linear_size: int

    @classmethod
    def of(
        cls,
        device: Device,
        cells: OpticalCells,
        box: SweptBox,
        packets: CellPackets,
        real: Real,
        *,
        turned: bool,
        linear_cells: NDArray[np.intp],
        by_ray: bool,
    ) -> "SweepArrays":
        """Uploads a box with K `linear_cells` among the scattering ones; `turned`: along y.

        A sweep by ray looks up packets by their places, one by tile goes through those of a row.
        """

        def packed(values: NDArray[np.float64]) -> NDArray[Any]:
            return packets.packed(turned_too(cells.dense(box, values.astype(real)))[turned])

        thermal = np.array([packed(cells.emitted[name]) for name in cells.needs.emitters], real)
        x, y, z = (cells.positions(cells.address) - np.asarray(box.low)).T
        _, ny, nz = box.shape
        place = packets.places(x * nz + z, y) if turned else packets.places(z * ny + y, x)
        packet, lane = np.divmod(place[linear_cells], PACKET)
        listed_packets, within = np.unique(packet, return_inverse=True)
        number = np.zeros(len(packets), np.int32)
        number[listed_packets] = np.arange(1, len(listed_packets) + 1)
        linear_size = len(listed_packets) * PACKET * len(cells.needs.components)
        return cls(
            packets=packets,
            turned=turned,
            rows=upload(device, "packets of rows", packets.number if by_ray else packets.first),
            begins=upload(device, "packets", np.column_stack([packets.along, number])),
            place=upload(device, "places", place),
            depth=upload(device, "optical depth", packed(cells.depth)),
            thermal=upload(device, "thermal sources", thermal),
            gradient_place=upload(device, "places", (within * PACKET + lane).astype(np.int32)),
            gradient=zeros(device, "spatial gradient", 3 * linear_size, real),
            linear_size=linear_size,
        )
