"""Images as ImageJ TIFF, which Fiji and napari open with names, units and scale."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.errors import RunFolderError, reason
from cldit.io.data_streams import DataStream
from cldit.io.files import make_folder, open_regular, whole


def checksum(image: NDArray[Any]) -> str:
    """SHA-256 of the pixels of `image` (..., H, W), row by row, little endian."""
    little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
    return hashlib.sha256(little.data).hexdigest()


def put_image(
    stream: IO[bytes],
    image: NDArray[Any],
    *,
    name: str,
    unit: str,
    pixel_m: tuple[float, float] | None = None,
    meta: dict[str, Any] | None = None,
) -> None:
    """Writes one image (H, W), or several (N, H, W), as ImageJ TIFF: float32, uint16 or uint8.

    Row 0 is at the top. `stream` has no descriptor (see `cldit.io.data_streams.DataStream`).
    `name` and `unit` of the values ("K", "1", "counts") are the label for viewers, `pixel_m`, the
    size of a pixel on the object, their scale bar; `meta` is plain data that `read_image` returns.
    Raises ValueError for another type or shape.
    """
    if image.dtype not in (np.float32, np.uint16, np.uint8) or image.ndim not in (2, 3):
        raise ValueError(f"{name}: {image.dtype} of shape {image.shape} is no image")
    info = {"name": name, "unit": unit, **(meta or {})}
    info.setdefault("sha256", checksum(image))
    resolution = None
    metadata: dict[str, Any] = {"axes": "YX", "Labels": [f"{name} [{unit}]"]}
    if image.ndim == 3:
        labels = [f"{name} {number} [{unit}]" for number in range(len(image))]
        metadata = {"axes": "TYX", "Labels": labels}
    if pixel_m is not None:
        resolution = (1e-3 / pixel_m[0], 1e-3 / pixel_m[1])  # pixels per mm
        metadata["unit"] = "mm"
        info["pixel_m"] = list(pixel_m)
    metadata["Info"] = json.dumps(info)
    tifffile.imwrite(stream, image, imagej=True, resolution=resolution, metadata=metadata)


def write_image(
    path: Path,
    image: NDArray[Any],
    *,
    name: str,
    unit: str,
    pixel_m: tuple[float, float] | None = None,
    meta: dict[str, Any] | None = None,
) -> None:
    """Writes images (H, W) or (N, H, W) as in `put_image`; the file appears whole or not at all."""
    with whole(path, needed_bytes=image.nbytes) as part, DataStream(part) as stream:
        put_image(stream, image, name=name, unit=unit, pixel_m=pixel_m, meta=meta)


def words(name: str) -> str:
    """Name of a map in words: `apparent temperature` for `apparent_temperature_K`."""
    return name.removesuffix("_K").replace("_", " ")


def write_maps(
    folder: Path, maps: Mapping[str, tuple[NDArray[Any], str]], *, pixel_m: tuple[float, float]
) -> None:
    """Writes maps (H, W) with their units as float32 into a folder, each in a file of its name."""
    for name, (image, unit) in maps.items():
        path = folder / f"{name}.tif"
        make_folder(path.parent)
        write_image(
            path, image.astype(np.float32), name=words(path.stem), unit=unit, pixel_m=pixel_m
        )


def read_image(path: Path) -> tuple[NDArray[Any], dict[str, Any]]:
    """Image and metadata that `write_image` wrote; other TIFFs have empty metadata.

    Raises RunFolderError if the file is missing, damaged, not an image, or if its pixels are not
    those that were written.
    """
    try:
        with open_regular(path) as stream, tifffile.TiffFile(stream) as tiff:
            image = np.asarray(tiff.asarray())
            imagej = tiff.imagej_metadata or {}
    except Exception as error:  # a damaged header causes many kinds of errors in tifffile
        raise RunFolderError(f"{path}: cannot be read as TIFF ({reason(error)})") from error
    try:
        info = json.loads(imagej.get("Info", "{}"))
    except json.JSONDecodeError:
        info = {}
    info = info if isinstance(info, dict) else {}
    if "sha256" in info and info["sha256"] != checksum(image):
        raise RunFolderError(f"{path}: is damaged: the pixels are not those that were recorded")
    return image, info
