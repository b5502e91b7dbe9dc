"""Results of a sweep as one labelled data set in Zarr, with a chunk for each scene.

OUT/study.zarr has maps over the axes of the grid and x and z of the image, OUT/study.json the grid
and the base scene. OUT/points/N.json is written when scene N is in the store, so the same call can
resume a sweep.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cldit.dit.maps import UNITS
from cldit.errors import StudyError
from cldit.io.content import digest
from cldit.io.exclusive import LOCK, is_empty
from cldit.io.extras import needed
from cldit.io.files import make_folder, write_text, written
from cldit.io.plain_data import read_json
from cldit.run import Run
from cldit.run.labelled import image_axes
from cldit.scene import Scene
from cldit.study.grid import Grid, Point

if TYPE_CHECKING:
    import xarray

_STORE = "study.zarr"
_MAPS = (
    "emissivity",
    "emissivity_standard_error",
    "apparent_temperature_K",
    "apparent_temperature_standard_error_K",
)
_FIGURES = {"liquid_mass_kg": "kg", "vapour_mass_kg": "kg", "error_K": "K", "error_at_least": "1"}
_LONG = {
    "error_K": "RMS error of T_app, all sources, as the trace of the scene states it",
    "error_at_least": "1 if a source of the error is unknown: error_K is a lower bound",
}
_FORMAT = 2  # 1: x and z in m, no total error


def extra(name: str) -> Any:
    """A module of the extra `studies`."""
    return needed(name, extra="studies", needed_by="a sweep", error=StudyError)


def results_of(run: Run) -> dict[str, NDArray[np.float32] | float]:
    """Maps (H, W) and numbers of a run that a data set contains; NaN if undefined."""
    results: dict[str, NDArray[np.float32] | float] = {
        name: getattr(run.maps, name) for name in _MAPS
    }
    results |= {name: run.info.spray.get(name, float("nan")) for name in _FIGURES}
    if run.errors is not None and run.errors.total_K is not None:
        results["error_K"] = run.errors.total_K
        results["error_at_least"] = float(bool(run.errors.unknown))
    return results


def done(folder: Path) -> set[int]:
    """Numbers of the scenes in the store of a sweep."""
    return {int(mark.stem) for mark in (folder / "points").glob("*.json")}


def write(
    folder: Path,
    point: Point,
    results: Mapping[str, NDArray[np.float32] | float],
    *,
    worker: str,
    seconds: float,
) -> None:
    """Writes the results of a scene into the store, and then its mark."""
    with written(folder / _STORE):
        store = extra("zarr").open_group(folder / _STORE, mode="r+")
        for name, value in {**results, "seconds": seconds}.items():
            store[name][point.place] = value
    content = json.dumps({"scene": point.scene.name, "worker": worker, "seconds": seconds})
    write_text(folder / "points" / f"{point.number}.json", content)


def open_folder(path: Path, base: Scene, grid: Grid) -> None:
    """Makes the folder of a sweep, or checks that it has this one."""
    axes = [[axis.name, axis.key, list(axis.values)] for axis in grid.axes]
    about = {"format": _FORMAT, "axes": axes, "scene": digest(base.model_dump(mode="json"))}
    record = path / "study.json"
    if not record.is_file():
        check_folder(path)
        make_folder(path)
        write_text(record, json.dumps(about, indent=1))  # first: it says what the folder is
    elif read_json(record, error=StudyError) != about:
        raise StudyError(
            f"{path}: has the sweep of another grid or scene, or of another version; give "
            "another folder with --out"
        )
    _make_store(path, base, grid)


def check_folder(path: Path) -> None:
    """Raises StudyError if a folder has other contents than a sweep, or the beginning of one."""
    names = {entry.name for entry in path.iterdir()} if path.is_dir() else set()
    begun = names <= {LOCK, "points", _STORE} and not any((path / "points").glob("*"))
    if not is_empty(path) and not begun and "study.json" not in names:
        raise StudyError(f"{path}: is not empty and has no sweep; give another folder with --out")


def _make_store(path: Path, base: Scene, grid: Grid) -> None:
    """Makes the empty store, unless it is there; its list of contents is written last."""
    make_folder(path / "points")
    if (path / _STORE / ".zmetadata").is_file():
        return
    with written(path / _STORE):
        if (path / _STORE).exists():
            shutil.rmtree(path / _STORE)
        template = _template(base, grid)
        template.to_zarr(path / _STORE, compute=False, zarr_format=2, consolidated=True)


def _template(base: Scene, grid: Grid) -> xarray.Dataset:
    """Data set of NaN, with labels and units."""
    xr, da = extra("xarray"), extra("dask.array")
    width, height = base.camera.pixels
    names = [axis.name for axis in grid.axes]
    coords: dict[str, Any] = {
        axis.name: (axis.name, _labels(axis.values), {"units": axis.unit, "scene_key": axis.key})
        for axis in grid.axes
    }
    pixel_m = base.camera.field_m[0] / width, base.camera.field_m[1] / height
    centre_m = base.target_m[0], base.target_m[2]
    coords |= image_axes((height, width), pixel_m=pixel_m, centre_m=centre_m)
    variables: dict[str, Any] = {}
    one_scene = tuple(1 for _ in grid.shape)  # in a chunk
    for name in _MAPS:
        shape, chunks = (*grid.shape, height, width), (*one_scene, height, width)
        empty = da.full(shape, np.nan, dtype=np.float32, chunks=chunks)
        variables[name] = ([*names, "z", "x"], empty, {"units": UNITS[name]})
    for name, unit in {**_FIGURES, "seconds": "s"}.items():
        empty = da.full(grid.shape, np.nan, chunks=one_scene)
        long = {"long_name": _LONG[name]} if name in _LONG else {}
        variables[name] = (names, empty, {"units": unit, **long})
    attrs = {
        "title": f"cldit sweep of {base.name}",
        "scene": json.dumps(base.model_dump(mode="json")),
    }
    return xr.Dataset(variables, coords, attrs)  # type: ignore[no-any-return]


def _labels(values: tuple[Any, ...]) -> NDArray[Any]:
    """Values as numbers if all are, else as text."""
    numbers = all(
        isinstance(value, (int, float)) and not isinstance(value, bool) for value in values
    )
    return np.array(values, dtype=float) if numbers else np.array([str(value) for value in values])


def open_study(path: str | Path) -> xarray.Dataset:
    """The results of a sweep (`cldit study SCENE --grid ...`) as one xarray data set.

    Dimensions are the axes of the grid by the names that were given, then z and x of the image in
    mm; each variable has its unit in `attrs["units"]`. Data are read as they are used; scenes that
    are not done yet are NaN.

    Args:
        path: folder of the sweep.

    Returns:
        Variables over the axes of the grid, z and x.

    Raises:
        StudyError: the folder has no sweep, or the extra `studies` is not installed.
    """
    store = Path(path) / _STORE
    if not store.is_dir() or not (Path(path) / "study.json").is_file():
        raise StudyError(
            f"{path}: has no sweep; `cldit study SCENE --grid ... --out DIR` makes one"
        )
    return extra("xarray").open_zarr(store, consolidated=True)  # type: ignore[no-any-return]
