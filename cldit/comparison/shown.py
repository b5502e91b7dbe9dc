"""Maps of a run or a measurement to be compared, with their position and errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from cldit.accuracy.error_maps import TOTAL
from cldit.acquisition.measured import Measured, open_recorded
from cldit.acquisition.plan import Group
from cldit.acquisition.record import maps_of_group
from cldit.acquisition.storage import RIG
from cldit.arrays import Floats
from cldit.camera.view import SensorView
from cldit.dit.budget import Part, load_parts
from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.io.plain_data import read_json, read_mapping
from cldit.optics.response import edges_um, from_plain
from cldit.run import Run, open_run
from cldit.scene import Scene

Observable = Literal["T_app", "emissivity"]


@dataclass(frozen=True, kw_only=True)
class Shown:
    """Maps to be compared.

    maps: (H, W). pixel_m: width and height of a pixel on the object. centre_m: (x, z) of the
    image's centre. error_K: stated standard error of T_app, RMS over its pixels; None if not
    stated. at_least: True if a cause of it is unknown. error_map_K: (H, W), in each pixel; None: as
    error_K. emissivity_error, emissivity_error_map: likewise of emissivity. common: parts of it
    that are one random number for all pixels. systematic: errors that it does not contain, of one
    stated spread each. run: the run of a trace; None for a recording. traced: the run whose errors
    the maps contain, that which was recorded included; None if unknown. noisy: True if the maps
    contain the noise of a camera. filter_um: edges of the filter; None: as the scene, or unknown.
    walls_spread_K: of their temperature, as stated. degrees: of freedom of the estimate of a
    pixel's error; infinite if it is known, or their number is not.
    """

    name: str
    maps: Maps
    pixel_m: tuple[float, float]
    centre_m: tuple[float, float]
    error_K: float | None = None
    at_least: bool = False
    error_map_K: Floats | None = None
    emissivity_error: float | None = None
    emissivity_error_map: Floats | None = None
    common: tuple[Part, ...] = ()
    systematic: tuple[Part, ...] = ()
    noisy: bool = False
    filter_um: tuple[float, float] | None = None
    walls_spread_K: float = 0.0
    degrees: float = math.inf
    scene: Scene | None = None
    run: Run | None = None
    traced: Run | None = None

    def independent_variance(self, observable: Observable = "T_app") -> Floats | None:
        """Variance (H, W) of errors that pixels do not share; None if no error is stated."""
        error, image = self.error_K, self.error_map_K
        if observable == "emissivity":
            error, image = self.emissivity_error, self.emissivity_error_map
        if error is None and image is None:
            return None
        uniform = np.full(self.maps.emissivity.shape, error or 0.0)
        square: Floats = (uniform if image is None else image) ** 2
        for part in self.common:
            square = square - np.nan_to_num(part.of(observable)) ** 2
        return np.maximum(square, 0.0)

    @property
    def independent_covariance_K(self) -> Floats:
        """Covariance (H, W) of the errors of emissivity and T_app that pixels do not share; NaN if
        their correlation is unknown."""
        maps = self.maps
        covariance: Floats = (
            maps.error_correlation.astype(np.float64)
            * maps.emissivity_standard_error
            * maps.apparent_temperature_standard_error_K
        )
        for part in self.common:
            covariance = covariance - np.nan_to_num(part.kelvin) * np.nan_to_num(part.emissivity)
        return covariance

    @property
    def grid(self) -> str:
        """Description of the pixels."""
        rows, columns = self.maps.emissivity.shape
        width, height = (1e3 * n * p for n, p in zip((columns, rows), self.pixel_m, strict=True))
        x, z = (1e3 * coordinate_m for coordinate_m in self.centre_m)
        return (
            f"{columns} x {rows} pixels over {width:.4g} x {height:.4g} mm around x {x:.4g}, "
            f"z {z:.4g} mm"
        )


OneFilter = str | Path | Run | Shown
Openable = OneFilter | Mapping[str, OneFilter]
"""A result of one filter or of several; or results by the names of their filters."""


def open_filters(of: Openable, *, acquired: bool = False) -> dict[str, Shown]:
    """Maps of a result by filter; the name is empty if the result names no filter.

    In a mapping, a result of several filters is that of the filter whose name it has.
    """
    if isinstance(of, Mapping):
        return {
            name: open_shown(result, acquired=acquired, filter_name=name)
            for name, result in of.items()
        }
    names = ("",) if acquired or isinstance(of, Run | Shown) else _filters(Path(of))
    return {name: open_shown(of, acquired=acquired, filter_name=name) for name in names}


def _filters(place: Path) -> tuple[str, ...]:
    """Names of the filters of a recording; an empty one if it, or a run, has none."""
    opened = None if (place / "scene.yaml").is_file() else open_recorded(place)
    named = () if opened is None or isinstance(opened, Measured) else opened.plan.filters
    return named or ("",)


def open_shown(of: OneFilter, *, acquired: bool = False, filter_name: str = "") -> Shown:
    """Maps of a run, of its recording if `acquired`, or of evaluated shots or measured data.

    of: a run, a folder, or measured.yaml. filter_name: of an acquisition with several filters.
    Raises RunFolderError if there are no such maps.
    """
    if isinstance(of, Shown):
        return of
    if isinstance(of, Run):
        return _recorded_by(of, of.scene.name) if acquired else _traced(of, of.scene.name)
    place = Path(of)
    if (place / "scene.yaml").is_file():
        run = open_run(place)
        return _recorded_by(run, str(place)) if acquired else _traced(run, str(place))
    opened = open_recorded(place)
    folder, name = opened.folder / "maps", str(place)
    if not isinstance(opened, Measured):
        plan = opened.plan
        if len(plan.delays) > 1:
            counts = f"{len(plan.delays)} delays"
            raise RunFolderError(f"{place}: contains {counts}; allowed: an acquisition of one")
        if len(plan.filters) > 1:
            if filter_name not in plan.filters:
                allowed = f"allowed: one of {', '.join(plan.filters)}"
                raise RunFolderError(f"{place}: filter {filter_name or 'none'}; {allowed}")
            name = f"{place}, {filter_name}"
        group = Group(plan.filters.index(filter_name) if len(plan.filters) > 1 else 0)
        folder, opened = maps_of_group(opened.folder, plan, group), opened.of_group(group)
        filter_name = plan.filter_name(group) or ""
    if not folder.is_dir():
        raise RunFolderError(f"{place}: is not evaluated yet; run `cldit evaluate {place}` first")
    traced = None if isinstance(opened, Measured) else _recorded_run(opened.folder, filter_name)
    maps = Maps.load(folder)
    recording = recorded(
        name,
        maps,
        opened.pixel_m,
        opened.centre_m,
        parts=load_parts(folder),
        degrees=_degrees(folder),
        traced=traced,
    )
    filter_um = from_plain(opened.calibration["filter_um"])
    spread_K = opened.surroundings.uncertainty.wall_temperature_K if traced is None else 0.0
    return replace(recording, filter_um=edges_um(filter_um), walls_spread_K=spread_K)


def _recorded_run(folder: Path, filter_name: str) -> Run | None:
    """Run whose light an acquisition contains: that around it, or that its simulated rig names."""
    file = folder / RIG
    rig = read_mapping(file) if file.is_file() else {}
    settings = (rig.get("bench") or {}).get("settings") or {}
    behind = (settings.get("filters") or {}).get(filter_name)
    parent = folder.resolve().parent
    if behind is None and (parent / "scene.yaml").is_file():
        return open_run(parent)
    named = settings.get("run") if behind is None else behind[0] if len(behind) == 1 else None
    if not isinstance(named, str) or settings.get("runs"):
        return None
    run = Path(rig.get("folder") or folder) / named
    return open_run(run) if (run / "run.json").is_file() else None


def _traced(run: Run, name: str) -> Shown:
    x, _, z = run.scene.target_m
    total_K, errors, maps = run.error_maps.get(TOTAL), run.errors, run.maps
    total = run.emissivity_error_maps.get(TOTAL)
    if total is not None:  # a trace has no noise of a sensor
        maps = replace(maps, emissivity_standard_error=total)
    return Shown(
        name=name,
        maps=maps,
        pixel_m=run.pixel_m,
        centre_m=(x, z),
        error_K=run.info.accuracy_K if errors is None else errors.total_K,
        at_least=errors is not None and bool(errors.unknown),
        error_map_K=None if total_K is None else total_K.astype(np.float64),
        emissivity_error=None if errors is None else errors.total_emissivity,
        emissivity_error_map=None if total is None else total.astype(np.float64),
        scene=run.scene,
        run=run,
        traced=run,
    )


def _recorded_by(run: Run, name: str) -> Shown:
    if run.measured is None:
        raise RunFolderError(f"{name}: has no acquisition; compare its trace")
    x, _, z = run.scene.target_m
    pixel_m = SensorView.from_scene(run.scene).pixel_m
    folder = None if run.folder is None else run.folder / "acquisition" / "maps"
    return recorded(
        name,
        run.measured,
        pixel_m,
        (x, z),
        parts=((), ()) if folder is None else load_parts(folder),
        degrees=() if folder is None else _degrees(folder),
        scene=run.scene,
        traced=run,
    )


def _degrees(maps: Path) -> Sequence[float]:
    """Degrees of freedom of an evaluation by background; none for one of an older version."""
    file = maps / "evaluation.json"
    return read_json(file).get("degrees_of_freedom", ()) if file.is_file() else ()


def recorded(
    name: str,
    maps: Maps,
    pixel_m: tuple[float, float],
    centre_m: tuple[float, float],
    *,
    parts: tuple[tuple[Part, ...], tuple[Part, ...]],
    degrees: Sequence[float] = (),
    scene: Scene | None = None,
    traced: Run | None = None,
) -> Shown:
    """Maps of a recording with its systematic and common `parts`.

    degrees: of freedom of the scatter between shots, by background. Two numbers are estimated from
    all of them (`cldit.dit.fit.shot_scatter`), so that the error of a pixel has half of their sum.
    The setup of a simulated rig is as stated: its recording has no systematic errors.
    """
    error_K = maps.apparent_temperature_standard_error_K.astype(np.float64)
    finite = np.isfinite(error_K) & np.isfinite(maps.apparent_temperature_K)
    square = maps.emissivity_standard_error[finite].astype(np.float64) ** 2
    return Shown(
        name=name,
        maps=maps,
        pixel_m=pixel_m,
        centre_m=centre_m,
        error_K=float(np.sqrt(np.mean(error_K[finite] ** 2))) if finite.any() else None,
        error_map_K=error_K,
        emissivity_error=float(np.sqrt(np.nanmean(square))) if finite.any() else None,
        emissivity_error_map=maps.emissivity_standard_error.astype(np.float64),
        common=tuple(replace(part, degrees=sum(degrees) or math.inf) for part in parts[1]),
        systematic=() if traced is not None else parts[0],
        noisy=True,
        degrees=sum(degrees) / 2.0 or math.inf,
        scene=scene,
        traced=traced,
    )
