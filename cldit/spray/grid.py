"""Optical coefficients on a regular grid, from an .npz file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cldit.arrays import Floats
from cldit.errors import SprayError
from cldit.io.files import open_regular
from cldit.scene.spray import GridSpray
from cldit.spray.result import Cells, Prescribed, Spray
from cldit.spray.spray_file import UNREADABLE, check_members

_COEFFICIENTS = (
    "vapour_absorption_per_m",
    "droplet_absorption_per_m",
    "droplet_scattering_per_m",
)
_EMITTERS = {
    "vapour_temperature_K": "vapour_absorption_per_m",
    "droplet_temperature_K": "droplet_absorption_per_m",
}
_TEMPERATURES = tuple(_EMITTERS)
_VECTORS = {"origin_m": (-100.0, 100.0), "spacing_m": (1e-9, 100.0)}
_NAMES = (*_VECTORS, *_COEFFICIENTS, *_TEMPERATURES)


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
    unknown = sorted(set(arrays) - set(_NAMES))
    if unknown:
        raise SprayError(f"{spec.file}: unknown array {unknown[0]}; allowed: {', '.join(_NAMES)}")
    for name, (low, high) in _VECTORS.items():
        if name not in arrays:
            raise SprayError(f"{spec.file}: {name} is missing; expected three numbers")
        if arrays[name].shape != (3,):
            raise SprayError(f"{spec.file}: {name}: shape {arrays[name].shape}, expected (3,)")
        _check(f"{spec.file}: {name}", arrays[name], low=low, high=high)

    present = {name: arrays[name] for name in _NAMES if name in arrays and name not in _VECTORS}
    if not present:
        raise SprayError(
            f"{spec.file}: no (nx, ny, nz) array; allowed: "
            f"{', '.join((*_COEFFICIENTS, *_TEMPERATURES))}"
        )
    first_name, leading = next(iter(present.items()))
    if leading.ndim != 3 or leading.size == 0:
        raise SprayError(
            f"{spec.file}: {first_name}: shape {leading.shape}, expected (nx, ny, nz), each at "
            "least 1"
        )
    filled = np.zeros(leading.size, dtype=bool)
    for name, values in present.items():
        if values.shape != leading.shape:
            raise SprayError(
                f"{spec.file}: {name}: shape {values.shape}, but {first_name} has {leading.shape}"
            )
        high = 5000.0 if name.endswith("_K") else 1e12
        _check(f"{spec.file}: {name}", values, low=0.0, high=high)
        if name in _COEFFICIENTS:
            filled |= values.reshape(-1) > 0.0
    for temperature, absorption in _EMITTERS.items():
        largest = float(np.max(present.get(absorption, 0.0)))
        if temperature not in present and largest > 0.0:
            raise SprayError(
                f"{spec.file}: {temperature} is missing, but {absorption} is up to {largest:g}; "
                f"expected temperatures of shape {leading.shape}"
            )

    index = np.flatnonzero(filled)
    nx, ny, nz = leading.shape
    cells = Cells.regular(
        origin_m=arrays["origin_m"],
        spacing_m=arrays["spacing_m"],
        shape=(nx, ny, nz),
        index=index,
    )
    zeros = np.zeros(len(index))
    kept = {
        name: present[name].reshape(-1)[index] if name in present else zeros
        for name in (*_COEFFICIENTS, *_TEMPERATURES)
    }
    notes = {"voxels": float(leading.size), "voxels_filled": float(len(index))}
    for name in _COEFFICIENTS:
        notes[f"{name}_max"] = float(kept[name].max(initial=0.0))
    return Spray(prescribed=Prescribed(cells, **kept), notes=notes)


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


def _check(label: str, values: Floats, *, low: float, high: float) -> None:
    inside = (values >= low) & (values <= high)  # false for NaN too
    if not inside.all():
        bad = np.unravel_index(int(np.argmin(inside)), values.shape)
        place = ", ".join(str(int(axis)) for axis in bad)
        raise SprayError(f"{label}: {values[bad]:g} at [{place}] is outside {low:g}..{high:g}")
