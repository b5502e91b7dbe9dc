"""A recorded run as one file for other programs: NeXus in HDF5.

It contains the raw counts as recorded, and the metadata of every image. The folder remains the
original: only it has the journal and survives a kill. Its images are TIFF, which ImageJ opens.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cldit.acquisition.record import Acquisition, Picture
from cldit.errors import ClditError
from cldit.io.data_streams import new_hdf
from cldit.io.extras import needed
from cldit.io.files import make_folder, whole

FORMATS = {"nexus": ".nxs"}


class ExportError(ClditError):
    """A run cannot be exported."""


def export(acquisition: Acquisition, form: str, target: Path | None = None) -> Path:
    """Writes all images of a run into one file, which appears whole or not at all.

    `form` is `nexus`, for which h5py is needed; `target` is by default
    `<folder>/<folder's name>.nxs`. Raises ExportError before anything is read if there is no such
    form, no image or no h5py; RunFolderError for a damaged image; DiskFull or FileError if the file
    cannot be written.
    """
    if form not in FORMATS:
        raise ExportError(f"--to: {form!r}; allowed: {', '.join(FORMATS)}")
    if not acquisition.shots:
        raise ExportError(f"{acquisition.folder}: holds no images yet")
    h5py = needed("h5py", extra="export", needed_by="--to nexus:", error=ExportError)
    folder = acquisition.folder
    path = target or folder / f"{folder.resolve().name}{FORMATS[form]}"
    make_folder(path.parent)
    images = len(acquisition.shots) * acquisition.plan.frames
    size_bytes = 2 * images * math.prod(acquisition.shape)  # of 16 bits
    with whole(path, needed_bytes=size_bytes) as part, new_hdf(part, h5py) as (file, check):
        _put_nexus(acquisition, file, check)
    return path


def _group(parent: Any, name: str, kind: str) -> Any:
    child = parent.create_group(name)
    child.attrs["NX_class"] = kind
    return child


def _put(parent: Any, name: str, values: Any, units: str | None = None) -> None:
    dataset = parent.create_dataset(name, data=values)
    if units is not None:
        dataset.attrs["units"] = units


def _put_nexus(acquisition: Acquisition, file: Any, check: Callable[[], None]) -> None:
    """Writes an NXentry with the instruments, the default plot, and the sequence of the images."""
    file.attrs["default"] = "entry"
    entry = _group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    _put(entry, "title", acquisition.configuration["rig"])
    instrument = _group(entry, "instrument", "NXinstrument")
    detector = _group(instrument, "detector", "NXdetector")
    shots, metadata = _put_images(acquisition, detector, check)
    black_body = _group(instrument, "black_body", "NXcollection")
    _put(black_body, "setpoint", [shot.background_setpoint_K for shot in shots], "K")
    _put(black_body, "temperature", [shot.background_K for shot in shots], "K")
    _put(entry, "start_time", metadata[0]["time"])
    _put(entry, "end_time", metadata[-1]["time"])
    _put_plot(acquisition, _group(entry, "data", "NXdata"), detector["data"])
    sequence = _group(entry, "sequence", "NXcollection")
    plan = acquisition.plan
    _put(sequence, "shot", [shot.id for shot in shots])
    _put(sequence, "frame", [*range(plan.frames)] * len(acquisition.shots))
    _put(sequence, "camera_delay", [plan.delays[shot.delay] for shot in shots], "s")
    if plan.filters:
        _put(sequence, "filter", [meta["filter"] for meta in metadata])
    _put(sequence, "complete", acquisition.complete)
    notes = (("configuration", acquisition.configuration), ("plan", plan.model_dump(mode="json")))
    for name, values in notes:
        note = _group(entry, name, "NXnote")
        _put(note, "type", "application/json")
        _put(note, "data", json.dumps(values))


def _put_images(
    acquisition: Acquisition, detector: Any, check: Callable[[], None]
) -> tuple[list[Picture], list[dict[str, Any]]]:
    """Writes all images with an image_key as in NXtomo: 0 with spray, 1 a reference (flat field).
    Returns shot and metadata of each."""
    frames = acquisition.plan.frames
    data = detector.create_dataset(
        "data",
        shape=(len(acquisition.shots) * frames, *acquisition.shape),
        dtype=np.uint16,
        chunks=(1, *acquisition.shape),
        compression="gzip",
        compression_opts=1,
        shuffle=True,
    )
    data.attrs["units"] = "counts"
    shots: list[Picture] = []
    metadata: list[dict[str, Any]] = []
    timestamps_ns: list[int] = []
    for shot in acquisition.shots:
        images, meta = acquisition.load_frames(shot)
        for image in images:
            data[len(shots)] = image
            check()
            shots.append(shot)
            metadata.append(meta)
        timestamps_ns += meta.get("frame_timestamps_ns") or [meta["device_timestamp_ns"]]
    _put(detector, "image_key", [int(shot.kind == "reference") for shot in shots])
    _put(detector, "count_time", [meta["integration_time_s"] for meta in metadata], "s")
    _put(detector, "timestamp", timestamps_ns, "ns")
    _put(detector, "saturation_value", [meta["saturation_counts"] for meta in metadata])
    _put(detector, "x_pixel_size", acquisition.pixel_m[0], "m")
    _put(detector, "y_pixel_size", acquisition.pixel_m[1], "m")
    _put(detector, "pixel_mask", acquisition.bad_pixels.astype(np.uint32))
    return shots, metadata


def _put_plot(acquisition: Acquisition, plot: Any, data: Any) -> None:
    """Writes the axes of the images: number, height and distance across the spray."""
    rows, columns = acquisition.shape
    plot["data"] = data
    right = np.arange(columns) - (columns - 1) / 2.0
    down = np.arange(rows) - (rows - 1) / 2.0
    _put(plot, "picture", np.arange(len(data)))
    _put(plot, "z", acquisition.centre_m[1] - down * acquisition.pixel_m[1], "m")
    _put(plot, "x", acquisition.centre_m[0] + right * acquisition.pixel_m[0], "m")
    plot.attrs["signal"] = "data"
    plot.attrs["axes"] = ["picture", "z", "x"]
