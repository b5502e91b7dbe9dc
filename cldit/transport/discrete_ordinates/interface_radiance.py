"""Interface radiance, stored by the final sweeps for the final gather (stages 3 and 5).

Path segments end with the radiance on the interfaces of the thick region.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cldit.gpu.buffers import unset, upload
from cldit.gpu.device import Device
from cldit.transport.cells import SweptBox
from cldit.transport.discrete_ordinates.axis_order import AxisOrder, axis_orders
from cldit.transport.thick_region import ThickRegion


@dataclass(frozen=True)
class InterfaceRadiance:
    """Radiance that enters the thick region.

    buffer: [interface][ordinate][component], so that the paths of a tile access few pages.
    interfaces, components, directions: numbers of interfaces, of values of a ray and of ordinates.
    rows, faces: table of interfaces by rows, for each order of axes; see kernels/sweep.cl.
    first: number of the sweep's first ordinate.
    """

    buffer: Any
    interfaces: int
    components: int
    directions: int
    rows: dict[int, Any]
    faces: dict[int, Any]
    first: int = 0

    def after(self, directions: int) -> "InterfaceRadiance":
        """Same buffer for a sweep that follows so many ordinates."""
        return replace(self, first=directions)

    @classmethod
    def of(
        cls,
        device: Device,
        thick: ThickRegion,
        box: SweptBox,
        *,
        components: int,
        directions: int,
        real: type[np.floating],
    ) -> "InterfaceRadiance":
        """Allocates the buffer and builds the tables of interfaces of a region.

        `components` is the number of values of a ray, see RAY_PLANES in blurred_boundary.h, and
        `directions` the number of ordinates.
        """
        owner, side = np.nonzero(thick.faces >= 0)
        number = thick.faces[owner, side]
        at = thick.at[owner]  # moved below to the cell that light leaves
        at[np.arange(len(at)), side // 2] += 2 * (side % 2) - 1
        rows, listed = {}, {}
        for layout in axis_orders(box.shape).values():
            along, across, up = at[:, layout.axes].T
            _, nv, nl = layout.size
            row = up * nv + across
            order = np.lexsort((along, row))
            starts = np.searchsorted(row[order], np.arange(nl * nv + 1))
            bit = 1 << (2 * np.argsort(layout.axes)[side // 2] + side % 2)
            table = np.column_stack([along, bit, number, number])[order]  # the last is not read
            rows[layout.number] = upload(device, "rows of faces", starts.astype(np.int32))
            listed[layout.number] = upload(device, "faces", table.astype(np.int32))
        size = thick.interfaces * directions * components
        stored = unset(device, "interface radiance", size, real)
        return cls(stored, thick.interfaces, components, directions, rows, listed)

    def arguments(self, layout: AxisOrder) -> dict[str, Any]:
        """Kernel arguments of the sweep for INTERFACE_RADIANCE."""
        return {
            "light": self.buffer,
            "earlier": self.first,
            "all": self.directions,
            "interface_rows": self.rows[layout.number],
            "interfaces": self.faces[layout.number],
        }
