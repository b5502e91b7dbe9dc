"""Optical coefficients on a regular grid, from an .npz file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.scene.spray import GridSpray
from cldit.spray.result import PRESCRIBED_LIMITS, Cells, Prescribed, Spray
from cldit.spray.spray_file import UNREADABLE, check_members

_EMITTERS = {
    "vapour_temperature_K": "vapour_absorption_per_m",
    "droplet_temperature_K": "droplet_absorption_per_m",
}
_VECTORS = {"origin_m": (-100.0, 100.0), "spacing_m": (1e-9, 100.0)}


def read_grid(spec: GridSpray) -> Spray:
    """Reads a grid file.

    The file contains `origin_m` (3,), the lower corner of the grid, `spacing_m` (3,), and any of
    the (nx, ny, nz) arrays `vapour_absorption_per_m`, `droplet_absorption_per_m`,
    `droplet_scattering_per_m`, `vapour_temperature_K`, `droplet_temperature_K`; a missing array is
    zero, and what absorbs needs a temperature. Voxels without absorption and scattering are
    omitted. The spray has `prescribed` and the figures `voxels`, `voxels_filled` and the largest of
    each coefficient.

    Raises:
        SprayError: the file is missing or not an .npz; an array is unknown, of another shape, not
            real, not finite, or outside its range; the temperature of absorbing droplets or vapour
            is missing. The message names file and array.
    """
    arrays = _load(spec.file)
    shape = _checked_shape(spec.file, arrays)
    coefficients = [name for name in PRESCRIBED_LIMITS if name.endswith("_per_m")]
    present = {name: arrays[name].reshape(-1) for name in PRESCRIBED_LIMITS if name in arrays}
    filled = [present[name] > 0.0 for name in coefficients if name in present]
    index = np.flatnonzero(np.any(filled, axis=0)) if filled else np.empty(0, np.int64)
    cells = Cells.regular(
        origin_m=arrays["origin_m"], spacing_m=arrays["spacing_m"], shape=shape, index=index
    )
    zeros = np.zeros(len(index))
    chosen = {
        name: present[name][index] if name in present else zeros for name in PRESCRIBED_LIMITS
    }
    notes = {"voxels": float(math.prod(shape)), "voxels_filled": float(len(index))}
    notes |= {f"{name}_max": float(chosen[name].max(initial=0.0)) for name in coefficients}
    return Spray(prescribed=Prescribed(cells, **chosen), notes=notes)


def _checked_shape(path: Path, arrays: dict[str, Floats]) -> tuple[int, int, int]:
    """Shape of the grid; raises SprayError as `read_grid` if an array is not as it says."""
    allowed = (*_VECTORS, *PRESCRIBED_LIMITS)
    unknown = sorted(set(arrays) - set(allowed))
    if unknown:
        raise SprayError(f"{path}: unknown array {unknown[0]}; allowed: {', '.join(allowed)}")
    for name, limits in _VECTORS.items():
        if name not in arrays:
            raise SprayError(f"{path}: {name} is missing; expected three numbers")
        if arrays[name].shape != (3,):
            raise SprayError(f"{path}: {name}: shape {arrays[name].shape}, expected (3,)")
        _check(f"{path}: {name}", arrays[name], *limits)
    present = [name for name in PRESCRIBED_LIMITS if name in arrays]
    if not present:
        names = ", ".join(PRESCRIBED_LIMITS)
        raise SprayError(f"{path}: no (nx, ny, nz) array; allowed: {names}")
    field, shape = present[0], arrays[present[0]].shape
    if len(shape) != 3 or 0 in shape:
        raise SprayError(f"{path}: {field}: shape {shape}, expected (nx, ny, nz), each at least 1")
    for name in present:
        if arrays[name].shape != shape:
            raise SprayError(f"{path}: {name}: shape {arrays[name].shape}, but {field} has {shape}")
        _check(f"{path}: {name}", arrays[name], *PRESCRIBED_LIMITS[name])
    for temperature, absorption in _EMITTERS.items():
        largest = float(np.max(arrays.get(absorption, 0.0)))
        if temperature not in present and largest > 0.0:
            raise SprayError(
                f"{path}: {temperature} is missing, but {absorption} is up to {largest:g}; "
                f"expected temperatures of shape {shape}"
            )
    return shape


def _load(path: Path) -> dict[str, Floats]:
    """All arrays of the file as float64, in C order."""
    if not path.exists():
        raise SprayError(f"{path}: no such grid file (spray.file)")
    try:
        with open_regular(path) as stream:
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise SprayError(f"{path}: a single array; expected an .npz of named arrays")
            assert archive.zip is not None
            check_members(archive.zip)
            raw = {name: np.asarray(archive[name]) for name in archive.files}
    except UNREADABLE as error:
        raise SprayError(f"{path}: cannot be read as .npz ({error})") from error
    for name, values in raw.items():
        if values.dtype.kind not in "fiub":
            raise SprayError(f"{path}: {name}: type {values.dtype}, expected real numbers")
    return {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in raw.items()}


def _check(label: str, values: Floats, low: float, high: float) -> None:
    inside = (values >= low) & (values <= high)  # false for NaN too
    if not inside.all():
        bad = np.unravel_index(int(np.argmin(inside)), values.shape)
        place = ", ".join(str(int(axis)) for axis in bad)
        raise SprayError(f"{label}: {values[bad]:g} at [{place}] is outside {low:g}..{high:g}")
