"""Maps of a run or a measurement to be compared, with their position and errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cldit.accuracy.error_maps import TOTAL
from cldit.acquisition.measured import Measured, open_recorded
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


@dataclass(frozen=True, kw_only=True)
class Shown:
    """Maps to be compared.

    maps: (H, W). pixel_m: width and height of a pixel on the object. centre_m: (x, z) of the
    image's centre. error_K: stated standard error of T_app, RMS over its pixels; None if not
    stated. at_least: True if a cause of it is unknown. error_map_K: (H, W), in each pixel; None: as
    error_K. emissivity_error: as error_K, of emissivity; a trace's maps have it in each pixel, by
    the simulation. common: parts of it that are one random number for all pixels. systematic:
    errors that it does not contain, of one stated spread each. run: the run of a trace; None for a
    recording. traced: the run whose errors the maps contain, that which was recorded included; None
    if unknown. noisy: True if the maps contain the noise of a camera. filter_um: edges of the
    filter; None: as the scene, or unknown. walls_spread_K: of their temperature, as stated.
    degrees: of freedom of the estimate of a pixel's error; infinite if it is known, or their number
    is not.
    """

    name: str
    maps: Maps
    pixel_m: tuple[float, float]
    centre_m: tuple[float, float]
    error_K: float | None = None
    at_least: bool = False
    error_map_K: Floats | None = None
    emissivity_error: float | None = None
    common: tuple[Part, ...] = ()
    systematic: tuple[Part, ...] = ()
    noisy: bool = False
    filter_um: tuple[float, float] | None = None
    walls_spread_K: float = 0.0
    degrees: float = math.inf
    scene: Scene | None = None
    run: Run | None = None
    traced: Run | None = None

    @property
    def independent_K2(self) -> Floats | None:
        """Variance (H, W) of errors that pixels do not share; None if no error is stated."""
        if self.error_K is None and self.error_map_K is None:
            return None
        uniform_K = np.full(self.maps.emissivity.shape, self.error_K or 0.0)
        square: Floats = (uniform_K if self.error_map_K is None else self.error_map_K) ** 2
        for part in self.common:
            square = square - np.nan_to_num(part.kelvin) ** 2
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


Openable = str | Path | Run | Shown


def open_shown(of: Openable, *, acquired: bool = False) -> Shown:
    """Maps of a run, of its recording if `acquired`, or of evaluated shots or measured data.

    of: a run, a folder, or measured.yaml. Raises RunFolderError if there are no such maps.
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
    if not isinstance(opened, Measured) and len(opened.plan.groups) > 1:
        filters, delays = max(len(opened.plan.filters), 1), len(opened.plan.delays)
        counts = f"{filters} filter(s) at {delays} delay(s)"
        raise RunFolderError(f"{place}: contains {counts}; allowed: an acquisition of one of each")
    folder = opened.folder / "maps"
    if not folder.is_dir():
        raise RunFolderError(f"{place}: is not evaluated yet; run `cldit evaluate {place}` first")
    traced = None if isinstance(opened, Measured) else _recorded_run(opened.folder)
    maps = Maps.load(folder)
    recording = recorded(
        str(place),
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


def _recorded_run(folder: Path) -> Run | None:
    """Run whose light an acquisition contains: that around it, or that its simulated rig names."""
    parent = folder.resolve().parent
    if (parent / "scene.yaml").is_file():
        return open_run(parent)
    file = folder / RIG
    rig = read_mapping(file) if file.is_file() else {}
    settings = (rig.get("bench") or {}).get("settings") or {}
    named = settings.get("run")
    if not isinstance(named, str) or settings.get("runs"):
        return None
    run = Path(rig.get("folder") or folder) / named
    return open_run(run) if (run / "run.json").is_file() else None


def _traced(run: Run, name: str) -> Shown:
    x, _, z = run.scene.target_m
    total_K, errors, maps = run.error_maps.get(TOTAL), run.errors, run.maps
    if TOTAL in run.emissivity_error_maps:  # a trace has no noise of a sensor
        maps = replace(maps, emissivity_standard_error=run.emissivity_error_maps[TOTAL])
    return Shown(
        name=name,
        maps=maps,
        pixel_m=run.pixel_m,
        centre_m=(x, z),
        error_K=run.info.accuracy_K if errors is None else errors.total_K,
        at_least=errors is not None and bool(errors.unknown),
        error_map_K=None if total_K is None else total_K.astype(np.float64),
        emissivity_error=None if errors is None else errors.total_emissivity,
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
        common=tuple(replace(part, degrees=sum(degrees) or math.inf) for part in parts[1]),
        systematic=() if traced is not None else parts[0],
        noisy=True,
        degrees=sum(degrees) / 2.0 or math.inf,
        scene=scene,
        traced=traced,
    )
