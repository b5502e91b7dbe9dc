"""A recorded run as one file for other programs: OME-TIFF, or NeXus in HDF5.

Both contain the raw counts as recorded, and the metadata of every image. The folder remains the
original: only it has the journal and survives a kill.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from cldit.acquisition.plan import Group
from cldit.acquisition.record import Acquisition, Picture
from cldit.errors import ClditError
from cldit.io.data_streams import DataStream, new_hdf
from cldit.io.extras import needed
from cldit.io.files import make_folder, whole

FORMATS = {"ome-tiff": ".ome.tif", "nexus": ".nxs"}


class ExportError(ClditError):
    """A run cannot be exported."""


def export(acquisition: Acquisition, form: str, target: Path | None = None) -> Path:
    """Writes all images of a run into one file, which appears whole or not at all.

    `form` is `ome-tiff`, or `nexus`, for which h5py is needed; `target` is by default
    `<folder>/<folder's name>.ome.tif` or `.nxs`. Raises ExportError before anything is read if
    there is no such form, no image or no h5py; RunFolderError for a damaged image; DiskFull or
    FileError if the file cannot be written.
    """
    if form not in FORMATS:
        raise ExportError(f"--to: {form!r}; allowed: {', '.join(FORMATS)}")
    if not acquisition.shots:
        raise ExportError(f"{acquisition.folder}: holds no images yet")
    if form == "nexus":
        needed("h5py", extra="export", needed_by="--to nexus:", error=ExportError)
    folder = acquisition.folder
    path = target or folder / f"{folder.resolve().name}{FORMATS[form]}"
    make_folder(path.parent)
    with whole(path, needed_bytes=_size_bytes(acquisition)) as part:
        (_write_ome if form == "ome-tiff" else _write_nexus)(acquisition, part)
    return path


def _size_bytes(acquisition: Acquisition) -> int:
    """Size of all images, of 16 bits."""
    return 2 * len(acquisition.shots) * acquisition.plan.frames * math.prod(acquisition.shape)


@dataclass(frozen=True)
class _Plane:
    """One image of one shot."""

    shot: Picture
    number: int
    image: NDArray[np.uint16]
    meta: dict[str, Any]

    @property
    def device_ns(self) -> int:
        times = self.meta.get("frame_timestamps_ns") or [self.meta["device_timestamp_ns"]]
        return int(times[self.number])


def _planes(acquisition: Acquisition, shots: list[Picture]) -> Iterator[_Plane]:
    for shot in shots:
        frames, meta = acquisition.load_frames(shot)
        for number, image in enumerate(frames):
            yield _Plane(shot, number, image, meta)


def _write_ome(acquisition: Acquisition, path: Path) -> None:
    """A series (OME Image) for each background, filter, delay and kind; T counts shots and
    frames."""
    frames, plan = acquisition.plan.frames, acquisition.plan
    width_m, height_m = acquisition.pixel_m

    def series(shot: Picture) -> tuple[int, int, int, bool]:
        return shot.background, shot.filter, shot.delay, shot.kind != "reference"

    big = _size_bytes(acquisition) > 2**32 - 2**25
    with DataStream(path) as stream, tifffile.TiffWriter(stream, ome=True, bigtiff=big) as tiff:
        for _, group in groupby(sorted(acquisition.shots, key=series), key=series):
            shots = list(group)
            setpoint_K, kind = shots[0].background_setpoint_K, shots[0].kind
            part = Group(shots[0].filter, shots[0].delay)
            at = f" at {', '.join(words)}" if (words := plan.words(part)) else ""
            name = plan.filter_name(part)
            # What is stored beside the images is small; the images pass one by one.
            planes = [plane.meta for plane in _planes(acquisition, shots)]
            exposure_s = [meta["integration_time_s"] for meta in planes]
            first_ns = planes[0]["host_timestamp_ns"]
            delta_s = [(meta["host_timestamp_ns"] - first_ns) * 1e-9 for meta in planes]
            tiff.write(
                (plane.image for plane in _planes(acquisition, shots)),
                shape=(len(planes), *acquisition.shape),
                dtype=np.uint16,
                photometric="minisblack",
                metadata={
                    "axes": "TYX",
                    "Name": f"{setpoint_K:g} K {kind}{at}",
                    "PhysicalSizeX": 1e3 * width_m,
                    "PhysicalSizeXUnit": "mm",
                    "PhysicalSizeY": 1e3 * height_m,
                    "PhysicalSizeYUnit": "mm",
                    "Plane": {
                        "ExposureTime": exposure_s,
                        "ExposureTimeUnit": ["s"] * len(planes),
                        "DeltaT": delta_s,
                        "DeltaTUnit": ["s"] * len(planes),
                    },
                    "MapAnnotation": {
                        "background_setpoint_K": f"{setpoint_K:g}",
                        "camera_delay_s": f"{plan.delays[part.delay]:.9g}",
                        **({} if name is None else {"filter": name}),
                        "kind": kind,
                        "shots": json.dumps([shot.id for shot in shots]),
                        "frames_per_shot": str(frames),
                        "background_K": json.dumps([shot.background_K for shot in shots]),
                        "calibration": json.dumps(acquisition.calibrations[part.filter]),
                    },
                },
            )


def _write_nexus(acquisition: Acquisition, path: Path) -> None:
    h5py = needed("h5py", extra="export", needed_by="--to nexus:", error=ExportError)
    with new_hdf(path, h5py) as (file, check):
        _put_nexus(acquisition, file, check)


def _put_nexus(acquisition: Acquisition, file: Any, check: Callable[[], None]) -> None:
    """NXdetector with an image_key as in NXtomo: 0 with spray, 1 a reference (flat field)."""
    rows, columns = acquisition.shape
    frames = acquisition.plan.frames
    count = len(acquisition.shots) * frames
    file.attrs["default"] = "entry"

    def group(parent: Any, name: str, kind: str) -> Any:
        child = parent.create_group(name)
        child.attrs["NX_class"] = kind
        return child

    def put(parent: Any, name: str, values: Any, units: str | None = None) -> Any:
        dataset = parent.create_dataset(name, data=values)
        if units is not None:
            dataset.attrs["units"] = units
        return dataset

    entry = group(file, "entry", "NXentry")
    entry.attrs["default"] = "data"
    put(entry, "title", acquisition.configuration["rig"])
    instrument = group(entry, "instrument", "NXinstrument")
    detector = group(instrument, "detector", "NXdetector")
    data = detector.create_dataset(
        "data",
        shape=(count, rows, columns),
        dtype=np.uint16,
        chunks=(1, rows, columns),
        compression="gzip",
        compression_opts=1,
        shuffle=True,
    )
    data.attrs["units"] = "counts"
    planes: list[_Plane] = []
    for index, plane in enumerate(_planes(acquisition, list(acquisition.shots))):
        data[index] = plane.image
        check()
        planes.append(_Plane(plane.shot, plane.number, plane.image[:0], plane.meta))
    put(detector, "image_key", [int(p.shot.kind == "reference") for p in planes])
    put(detector, "count_time", [p.meta["integration_time_s"] for p in planes], "s")
    put(detector, "timestamp", [p.device_ns for p in planes], "ns")
    put(detector, "saturation_value", [p.meta["saturation_counts"] for p in planes])
    put(detector, "x_pixel_size", acquisition.pixel_m[0], "m")
    put(detector, "y_pixel_size", acquisition.pixel_m[1], "m")
    put(detector, "pixel_mask", acquisition.bad_pixels.astype(np.uint32))
    black_body = group(instrument, "black_body", "NXcollection")
    put(black_body, "setpoint", [p.shot.background_setpoint_K for p in planes], "K")
    put(black_body, "temperature", [p.shot.background_K for p in planes], "K")
    put(entry, "start_time", planes[0].meta["time"])
    put(entry, "end_time", planes[-1].meta["time"])
    shown = group(entry, "data", "NXdata")
    shown["data"] = data
    right = np.arange(columns) - (columns - 1) / 2.0
    down = np.arange(rows) - (rows - 1) / 2.0
    put(shown, "picture", np.arange(count))
    put(shown, "z", acquisition.centre_m[1] - down * acquisition.pixel_m[1], "m")
    put(shown, "x", acquisition.centre_m[0] + right * acquisition.pixel_m[0], "m")
    shown.attrs["signal"] = "data"
    shown.attrs["axes"] = ["picture", "z", "x"]
    sequence = group(entry, "sequence", "NXcollection")
    put(sequence, "shot", [p.shot.id for p in planes])
    put(sequence, "frame", [p.number for p in planes])
    delays = acquisition.plan.delays
    put(sequence, "camera_delay", [delays[p.shot.delay] for p in planes], "s")
    if acquisition.plan.filters:
        put(sequence, "filter", [p.meta["filter"] for p in planes])
    put(sequence, "complete", acquisition.complete)
    for name, values in (
        ("configuration", acquisition.configuration),
        ("plan", acquisition.plan.model_dump(mode="json")),
    ):
        note = group(entry, name, "NXnote")
        put(note, "type", "application/json")
        put(note, "data", json.dumps(values))
