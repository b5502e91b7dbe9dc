"""Images as ImageJ TIFF: what Fiji and napari open with names, units and scale."""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO, Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.errors import RunFolderError
from cldit.io.data_streams import DataStream
from cldit.io.files import open_regular, whole


def put_image(
    stream: IO[bytes],
    image: NDArray[Any],
    *,
    name: str,
    unit: str,
    pixel_m: tuple[float, float] | None = None,
    meta: dict[str, Any] | None = None,
) -> None:
    """Writes one picture (H, W), or several (N, H, W), as ImageJ TIFF: float32, uint16 or uint8.

    Row 0 is at the top.

    Args:
        stream: open for writing, with no file number (see `cldit.io.data_streams.DataStream`).
        image: (H, W) or (N, H, W).
        name: what the picture shows, as the viewer's label.
        unit: unit of the pixel values ("K", "1", "counts").
        pixel_m: width and height of a pixel on the object, for the viewer's scale bar.
        meta: anything JSON can hold; `read_image` gives it back.

    Raises:
        ValueError: another type or shape.
    """
    if image.dtype not in (np.float32, np.uint16, np.uint8) or image.ndim not in (2, 3):
        raise ValueError(f"{name}: {image.dtype} of shape {image.shape} is no picture")
    info = {"name": name, "unit": unit, **(meta or {})}
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
    """Writes one picture, (H, W) or (N, H, W), as ImageJ TIFF.

    The file appears whole or not at all: it is written beside its place, synced, and renamed.

    Args:
        path: the file.
        image, name, unit, pixel_m, meta: as in `put_image`.
    """
    with whole(path, needed_bytes=image.nbytes) as part, DataStream(part) as stream:
        put_image(stream, image, name=name, unit=unit, pixel_m=pixel_m, meta=meta)


def read_image(path: Path) -> tuple[NDArray[Any], dict[str, Any]]:
    """Picture and metadata that `write_image` wrote; foreign TIFFs come with empty metadata.

    Raises:
        RunFolderError: the file is missing, damaged, or not a picture.
    """
    try:
        with open_regular(path) as stream, tifffile.TiffFile(stream) as tiff:
            image = np.asarray(tiff.asarray())
            imagej = tiff.imagej_metadata or {}
    except Exception as error:  # a damaged header leads tifffile into errors of many kinds
        raise RunFolderError(f"{path}: cannot be read as TIFF ({error})") from error
    try:
        info = json.loads(imagej.get("Info", "{}"))
    except json.JSONDecodeError:
        info = {}
    return image, info if isinstance(info, dict) else {}
