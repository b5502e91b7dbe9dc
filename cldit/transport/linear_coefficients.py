"""Coefficients that are linear within cells, for all rays but those of the sweeps.

The absorption of vapour and the absorption and scattering of droplets have a gradient each,
k(x) = k_mean (1 + g . (x - x_c)), found from the neighbours. Along an axis g is the central
difference, limited to twice the one-sided differences, and 0 where these differ in sign
(monotonized central limiter: van Leer, J. Comput. Phys. 23, 1977). No value beyond those of the
neighbours arises: a uniform block stays uniform up to its sides. Then g is shortened where k would
be negative at a corner of the cell. A neighbour of another size counts at the distance of its
middle; an empty one is empty next to the cell as well.

The extinction is the sum of the three. Emission over extinction and albedo vary within the cell as
well: T_app, in which the extinction nearly cancels, would not gain otherwise. They are linear too,
to first order. Their values in the middle are set so that a cell emits and scatters as its means
say: the mean of (1 + g . x)(S + s . x) is S + g . s / 12.

Those of stored cells are found on the device (kernels/linear_coefficients.cl), those of coarse
leaves, which are few, here.
"""

from typing import Any

import numpy as np

from cldit.arrays import Ints, Reals
from cldit.gpu.buffers import unset, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import GROUP, Program, build
from cldit.medium.frame import BRICK, CELLS_PER_BRICK
from cldit.medium.limiter import limited
from cldit.medium.octree import Octree
from cldit.transport.cells import DEEPEST, OpticalCells

LEAST = 2.0**-10  # least extinction at a corner, over the mean, as in linear_coefficients.cl
_FIELDS = (
    "vapour_absorption",
    "droplet_absorption",
    "droplet_scattering",
    "vapour_emission",
    "droplet_emission",
)


def device_cells(
    device: Device, cells: OpticalCells, real: type[np.floating], *, linear: bool
) -> dict[str, Any]:
    """Kernel arguments of a medium: octree, optical depths, and albedos and thermal sources.

    `linear`: coefficients are linear in cells, with their gradients; albedos and sources are those
    of the middles then. The arrays are kept with `cells`, for all stages of a trace.
    """
    stored_buffers: dict[str, Any] | None = cells.on_device.get((id(device.opened), real, linear))
    if stored_buffers is not None:
        return stored_buffers
    tree, stored = cells.tree, len(cells.depth)
    spans = np.maximum(1, tree.frame.cells >> tree.coarse_level).astype(np.int32)
    place = np.argwhere(tree.directory >= 0)
    corners = np.zeros((max(tree.slots, 1), 4), np.int32)
    corners[tree.directory[tuple(place.T)], :3] = place[:, ::-1]
    out = {
        "directory": upload(device, "octree", tree.directory),
        "span": upload(device, "coarse leaves", spans),
        "corners": upload(device, "octree", corners),
    }
    emitters = len(cells.needs.emitters)
    if linear:
        out |= {
            "depth": unset(device, "optical depth", stored, real),
            "albedo": unset(device, "albedo", stored, real),
            "thermal": unset(device, "thermal source", emitters * stored, real),
            "cell_gradients": unset(
                device, "gradients in cells", 3 * (2 + emitters) * stored, real
            ),
        }
        slopes = np.stack([_coarse(tree, tree.fields[name]).T for name in _FIELDS])
        fields = np.stack([tree.fields[name] for name in _FIELDS])
        _program(device, cells, real).launch(
            "coefficients",
            (stored,),
            (GROUP,),
            {
                **out,
                "fields": upload(device, "coefficients", fields.astype(np.float32, copy=False)),
                "leaf_slopes": upload(device, "coefficients", slopes.astype(np.float32)),
                "bricks": tree.frame.bricks,
                "coarse": tree.slots * CELLS_PER_BRICK,
                "stored": stored,
                "cell_m": float(tree.frame.cell_m),
                "deepest": DEEPEST / tree.frame.cells,
                "scale": float(cells.scale),
                "first_emission": _FIELDS.index("vapour_emission") + (not cells.needs.vapour),
            },
        )
    else:
        albedo = np.zeros(stored, real)
        albedo[cells.address] = cells.albedo
        out |= {
            "depth": upload(device, "optical depth", cells.depth.astype(real)),
            "albedo": upload(device, "albedo", albedo),
            "thermal": upload(device, "thermal source", cells.thermal_planes(real)),
        }
    cells.on_device[id(device.opened), real, linear] = out
    return out


def thick_albedo(
    device: Device, cells: OpticalCells, thick: Ints, real: type[np.floating], *, linear: bool
) -> Any:
    """Buffer of the albedos (P,) of `thick` scattering cells (T,), 0 in all others."""
    out = zeros(device, "albedo", len(cells.depth), real)
    _program(device, cells, real).launch(
        "some_albedos",
        (len(thick),),
        (GROUP,),
        {
            "some": out,
            "albedo": device_cells(device, cells, real, linear=linear)["albedo"],
            "address": upload(device, "thick cells", cells.address[thick].astype(np.int32)),
            "count": len(thick),
        },
    )
    return out


def _program(device: Device, cells: OpticalCells, real: type[np.floating]) -> Program:
    double = {"USE_FLOAT64": 1} if real is np.float64 else {}
    return build(device, "linear_coefficients.cl", {**cells.needs.defines, **double})


def _positive(depth: Reals, slopes: Reals) -> Reals:
    """Slopes (3, N) over the mean (N,), shortened so that corners are at least LEAST of it."""
    safe = np.where(depth > 0, depth, 1.0)
    relative = np.where(depth > 0, slopes / safe, 0.0)
    reach = np.abs(relative).sum(axis=0) / 2
    return np.asarray(relative / np.maximum(reach / (1.0 - LEAST), 1.0))


def _coarse(tree: Octree, depth: Reals) -> Reals:
    """Relative gradient (L, 3) of coarse leaves, per finest cell."""
    fine, levels = tree.slots * CELLS_PER_BRICK, tree.coarse_level
    out = np.zeros((len(levels), 3))
    means = np.empty(tree.directory.shape)
    is_divided = tree.directory >= 0
    side = min(BRICK, tree.frame.cells)
    bricks = depth[:fine].reshape(-1, BRICK, BRICK, BRICK)[:, :side, :side, :side]
    means[is_divided] = bricks.mean(axis=(1, 2, 3))[tree.directory[is_divided]]
    means[~is_divided] = depth[fine - 1 - tree.directory[~is_divided]]
    spans = np.ones(tree.directory.shape, np.int64)  # of each brick's leaf, in bricks
    spans[~is_divided] = np.maximum(
        1, tree.frame.bricks >> levels[-1 - tree.directory[~is_divided]]
    )
    edge = 1  # of the leaves, in bricks
    while edge < tree.frame.bricks:
        number = -1 - tree.directory[::edge, ::edge, ::edge]
        on_level = (spans[::edge, ::edge, ::edge] == edge) & (number >= 0)
        count = len(number)
        blocks = means.reshape(count, edge, count, edge, count, edge).mean(axis=(1, 3, 5))
        on_level &= blocks > 0
        if on_level.any():
            padded = np.pad(blocks, 1)
            wide = np.maximum(spans[::edge, ::edge, ::edge] // edge, 1)
            wide = np.pad(np.where(blocks > 0, wide, 1), 1, constant_values=1)
            at = np.argwhere(on_level) + 1
            slopes = np.empty((3, len(at)))
            for axis in range(3):
                step = np.eye(3, dtype=np.int64)[axis]
                low, high = tuple((at - step).T), tuple((at + step).T)
                slopes[2 - axis] = limited(
                    blocks[on_level],
                    padded[low],
                    padded[high],
                    down=(1 + wide[low]) / 2,
                    up=(1 + wide[high]) / 2,
                )
            out[number[on_level]] = _positive(blocks[on_level], slopes).T / (edge * side)
        edge *= 2
    return out
