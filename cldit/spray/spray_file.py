"""File format of a spray: an .npz with the data of `Spray`, in SI and in the project's frame.

Arrays: `parcels/position_m`, `parcels/diameter_m`, ...; `parcels/box_m` (3,) if parcels fill boxes,
`parcels/covariance_m2` if they are clouds, `parcels/velocity_m_s` if it is known;
`vapour/lower_m`, `vapour/upper_m`, `vapour/number_density_m3`, `vapour/temperature_K`; and `about`,
a JSON text with the version of the layout, the molar mass, the fuel, notes, remarks and the files
read. Other arrays are ignored. The file is written atomically.
"""

from __future__ import annotations

import json
import lzma
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import FileError, SprayError
from cldit.io.data_streams import DataStream
from cldit.io.files import open_regular, whole
from cldit.io.free_memory import free_bytes
from cldit.io.origin import FileRead
from cldit.io.progress import Watch, silent
from cldit.spray.extent import Box, Cloud, Extent
from cldit.spray.result import PARCEL_LIMITS, Cells, Parcels, Spray, Vapour

LAYOUT = 2
_KNOWN = (1, LAYOUT)  # the first had no boxes and no clouds
_CORNERS = ("vapour/lower_m", "vapour/upper_m")  # shrink to a ninth; the rest hardly does
_AT_ONCE = 1 << 22  # bytes between two reports of progress
UNREADABLE = (
    OSError,
    ValueError,
    EOFError,
    TypeError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    MemoryError,  # of a shape in a damaged header
    RuntimeError,  # a flag or method that zipfile does not support, in a damaged file
)
_PARCELS = ("position_m", *PARCEL_LIMITS)
_VAPOUR = ("lower_m", "upper_m", "number_density_m3", "temperature_K")


def write_spray(path: Path, spray: Spray, *, watch: Watch = silent) -> None:
    """Writes parcels and vapour of `spray` to `path`.

    Args:
        path: of the file, which is written atomically.
        spray: to be written.
        watch: receives the progress.

    Raises:
        SprayError: the name does not end in .npz, or the file cannot be written.
    """
    if path.suffix != ".npz":
        raise SprayError(f"{path}: cldit's own file ends in .npz")
    members = _members(spray)
    size, done = sum(values.nbytes for values in members.values()), 0
    try:
        with (
            whole(path) as part,
            DataStream(part) as stream,
            zipfile.ZipFile(stream, "w", compresslevel=zlib.Z_BEST_SPEED) as archive,
        ):
            for name, values in members.items():
                shrinks = name in _CORNERS
                archive.compression = zipfile.ZIP_DEFLATED if shrinks else zipfile.ZIP_STORED
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    head = np.lib.format.header_data_from_array_1_0(values)
                    np.lib.format.write_array_header_1_0(member, head)
                    raw = values.reshape(-1).view(np.uint8).data
                    for begin in range(0, len(raw), _AT_ONCE):
                        watch(f"writing {path.name}", done, size)
                        done += member.write(raw[begin : begin + _AT_ONCE])
    except FileError as error:
        raise SprayError(str(error)) from error
    except OSError as error:
        raise SprayError(f"{path}: cannot be written ({error})") from error


def _members(spray: Spray) -> dict[str, NDArray[Any]]:
    """Arrays of the file by name, in C order."""
    about: dict[str, object] = {
        "layout": LAYOUT,
        "notes": spray.notes,
        "remarks": list(spray.remarks),
        "files": [file.to_dict() for file in spray.files],
        "fuel": spray.fuel,
    }
    arrays: dict[str, NDArray[Any]] = {}
    if (parcels := spray.parcels) is not None:
        arrays |= {f"parcels/{name}": getattr(parcels, name) for name in _PARCELS}
        if parcels.velocity_m_s is not None:
            arrays["parcels/velocity_m_s"] = parcels.velocity_m_s
        match parcels.extent:
            case Box(edge_m):
                arrays["parcels/box_m"] = edge_m
            case Cloud(covariance_m2):
                arrays["parcels/covariance_m2"] = covariance_m2
    if (vapour := spray.vapour) is not None:
        about["molar_mass_kg_mol"] = vapour.molar_mass_kg_mol
        cells = vapour.cells.lower_m, vapour.cells.upper_m
        values = (*cells, vapour.number_density_m3, vapour.temperature_K)
        arrays |= {f"vapour/{name}": array for name, array in zip(_VAPOUR, values, strict=True)}
    members = {"about": np.array(json.dumps(about)), **arrays}
    return {name: np.asarray(array, order="C") for name, array in members.items()}


def _extent(arrays: dict[str, Floats]) -> Extent | None:
    if "parcels/box_m" in arrays:
        return Box(arrays["parcels/box_m"])
    if "parcels/covariance_m2" in arrays:
        return Cloud(arrays["parcels/covariance_m2"])
    return None


def _member(archive: zipfile.ZipFile, name: str) -> Floats:
    """An array, read to the end of its member, so that its checksum is compared."""
    with archive.open(name) as stream:
        values = np.lib.format.read_array(stream, allow_pickle=False)
        if stream.read(1):
            raise ValueError(f"{name} has data after its array")
    return np.asarray(values)


def check_members(archive: zipfile.ZipFile) -> None:
    """Refuses an archive with a name twice, or with more content than memory is free."""
    names = archive.namelist()
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"has {twice[0]} twice")
    size, free = sum(member.file_size for member in archive.infolist()), free_bytes()
    if free is not None and size > free:
        raise ValueError(f"unpacks to {size / 1e9:.2g} GB; {free / 1e9:.2g} GB of memory are free")


def read_spray(path: Path) -> Spray:
    """Reads a file of `write_spray`.

    Args:
        path: .npz file.

    Returns:
        The spray in cldit's frame.

    Raises:
        SprayError: the file is missing, damaged, cut off, of another layout, or lacks an array.
    """
    try:
        with open_regular(path) as stream, zipfile.ZipFile(stream) as archive:
            check_members(archive)
            arrays = {
                name.removesuffix(".npy"): _member(archive, name) for name in archive.namelist()
            }
    except UNREADABLE as error:
        raise SprayError(f"{path}: cannot be read as cldit's file: {error}") from error
    try:
        about = json.loads(str(arrays["about"]))
        if about["layout"] not in _KNOWN:
            raise SprayError(f"{path}: layout {about['layout']} is unknown; import the case again")
        parcels = vapour = None
        if any(name.startswith("parcels/") for name in arrays):
            values = {name: arrays[f"parcels/{name}"] for name in _PARCELS}
            velocity = arrays.get("parcels/velocity_m_s")
            parcels = Parcels(**values, extent=_extent(arrays), velocity_m_s=velocity)
        if any(name.startswith("vapour/") for name in arrays):
            lower, upper, number, temperature = (arrays[f"vapour/{name}"] for name in _VAPOUR)
            vapour = Vapour(
                Cells(lower, upper), number, temperature, float(about["molar_mass_kg_mol"])
            )
        notes = {str(name): float(value) for name, value in about["notes"].items()}
        remarks = tuple(map(str, about["remarks"]))
        files = tuple(FileRead.from_dict(entry) for entry in about.get("files", []))
        fuel = str(about.get("fuel", ""))
    except KeyError as error:
        raise SprayError(f"{path}: {error.args[0]} is missing") from error
    except SprayError as error:
        raise error if str(path) in str(error) else SprayError(f"{path}: {error}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise SprayError(f"{path}: not a spray file of cldit ({error})") from error
    return Spray(parcels, vapour, notes=notes, remarks=remarks, files=files, fuel=fuel)
