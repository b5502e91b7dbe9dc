"""cldit's own file of a spray: an .npz that holds what `Spray` holds, in SI and in our frame.

Arrays `parcels/position_m`, `parcels/diameter_m`, ..., where parcels fill boxes `parcels/box_m`
(3,), where they are clouds `parcels/covariance_m2`, `vapour/lower_m`, `vapour/upper_m`,
`vapour/number_density_m3`, `vapour/temperature_K`, and `about`, a JSON text with the version of the
layout, the molar mass, notes, remarks and the files read. Cells of a regular grid have its
`vapour/grid_origin_m`, `vapour/grid_spacing_m`, `vapour/grid_shape` and `vapour/grid_index` too.
Written at once: a file is whole or not there.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from pathlib import Path

import numpy as np

from cldit.errors import SprayError
from cldit.files import whole
from cldit.provenance import FileRead
from cldit.spray.extent import Box, Cloud, Extent
from cldit.spray.result import Cells, Floats, Parcels, RegularGrid, Spray, Vapour

LAYOUT = 2
_KNOWN = (1, LAYOUT)  # the first had no boxes and no clouds
_PARCELS = ("position_m", "diameter_m", "droplets", "temperature_K", "density_kg_m3")
_VAPOUR = ("lower_m", "upper_m", "number_density_m3", "temperature_K")


def write_spray(path: Path, spray: Spray) -> None:
    """Writes parcels and vapour of `spray` to `path`.

    Raises:
        SprayError: the name does not end in .npz, or the file cannot be written.
    """
    if path.suffix != ".npz":
        raise SprayError(f"{path}: cldit's own file ends in .npz")
    about: dict[str, object] = {
        "layout": LAYOUT,
        "notes": spray.notes,
        "remarks": list(spray.remarks),
        "files": [file.to_dict() for file in spray.files],
    }
    arrays: dict[str, Floats] = {}
    if spray.parcels is not None:
        arrays |= {f"parcels/{name}": getattr(spray.parcels, name) for name in _PARCELS}
        match spray.parcels.extent:
            case Box(edge_m):
                arrays["parcels/box_m"] = edge_m
            case Cloud(covariance_m2):
                arrays["parcels/covariance_m2"] = covariance_m2
    if spray.vapour is not None:
        about["molar_mass_kg_mol"] = spray.vapour.molar_mass_kg_mol
        arrays |= {
            "vapour/lower_m": spray.vapour.cells.lower_m,
            "vapour/upper_m": spray.vapour.cells.upper_m,
            "vapour/number_density_m3": spray.vapour.number_density_m3,
            "vapour/temperature_K": spray.vapour.temperature_K,
        }
        if (grid := spray.vapour.cells.grid) is not None:
            arrays |= {
                "vapour/grid_origin_m": grid.origin_m,
                "vapour/grid_spacing_m": grid.spacing_m,
                "vapour/grid_shape": np.array(grid.shape, dtype=float),
                "vapour/grid_index": grid.index.astype(float),
            }
    try:
        with whole(path) as part, part.open("wb") as stream:
            np.savez_compressed(stream, about=np.array(json.dumps(about)), **arrays)  # type: ignore[arg-type]
    except OSError as error:
        raise SprayError(f"{path}: cannot be written ({error})") from error


def _grid(arrays: dict[str, Floats]) -> RegularGrid | None:
    if "vapour/grid_shape" not in arrays:
        return None
    x, y, z = (int(count) for count in arrays["vapour/grid_shape"])
    return RegularGrid(
        arrays["vapour/grid_origin_m"],
        arrays["vapour/grid_spacing_m"],
        (x, y, z),
        arrays["vapour/grid_index"].astype(np.int64),
    )


def _extent(arrays: dict[str, Floats]) -> Extent | None:
    if "parcels/box_m" in arrays:
        return Box(arrays["parcels/box_m"])
    if "parcels/covariance_m2" in arrays:
        return Cloud(arrays["parcels/covariance_m2"])
    return None


def read_spray(path: Path) -> Spray:
    """Reads what `write_spray` wrote.

    Raises:
        SprayError: the file is missing, damaged, cut off, of another layout, or lacks an array.
    """
    try:
        with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            # whole members, so that their checksums are compared, which np.load leaves out
            members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
        arrays = {
            name: np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
            for name, content in members.items()
        }
    # a RuntimeError is a damaged flag: encrypted, or of an unknown compression
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        TypeError,
        RuntimeError,
    ) as error:
        raise SprayError(f"{path}: cannot be read as cldit's file: {error}") from error
    try:
        about = json.loads(str(arrays["about"]))
        if about["layout"] not in _KNOWN:
            raise SprayError(f"{path}: layout {about['layout']} is unknown; import the case again")
        parcels = vapour = None
        if any(name.startswith("parcels/") for name in arrays):
            values = {name: arrays[f"parcels/{name}"] for name in _PARCELS}
            parcels = Parcels(**values, extent=_extent(arrays))
        if any(name.startswith("vapour/") for name in arrays):
            lower, upper, number, temperature = (arrays[f"vapour/{name}"] for name in _VAPOUR)
            cells = Cells(lower, upper, _grid(arrays))
            vapour = Vapour(cells, number, temperature, float(about["molar_mass_kg_mol"]))
        notes = {str(name): float(value) for name, value in about["notes"].items()}
        remarks = tuple(map(str, about["remarks"]))
        files = tuple(FileRead.from_dict(each) for each in about.get("files", []))
    except KeyError as error:
        raise SprayError(f"{path}: {error.args[0]} is missing") from error
    except SprayError as error:
        raise error if str(path) in str(error) else SprayError(f"{path}: {error}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise SprayError(f"{path}: is no file of cldit's ({error})") from error
    return Spray(parcels=parcels, vapour=vapour, notes=notes, remarks=remarks, files=files)
