"""The result of a run, and its metadata."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from cldit.accuracy.error_maps import TOTAL
from cldit.accuracy.errors import Errors
from cldit.camera.view import SensorView
from cldit.dit.maps import Maps
from cldit.dit.profile import Profile, profile_of
from cldit.errors import RunFolderError
from cldit.io.digests import write_sealed
from cldit.io.exclusive import is_empty
from cldit.io.files import make_folder, write_text, written
from cldit.io.images import write_image
from cldit.io.origin import FileRead, Origin
from cldit.io.presented import Presented
from cldit.optics.spectral import Quadrature
from cldit.prepare.stages import Stage
from cldit.radiance.weights import Weights
from cldit.run.ensemble_statistics import STATISTICS, Ensemble
from cldit.run.labelled import labelled
from cldit.run.spectral import SpectralInfo
from cldit.run.stored_files import (
    EMISSIVITY_ERRORS,
    RAYS,
    SCENE_FILE,
    save_maps,
    save_nodes,
)
from cldit.scene import Scene, dump_scene
from cldit.transport.energy_balance import EnergyBalance

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class RunInfo:
    """Metadata stored with a run; everything here can be written as JSON."""

    __pydantic_config__: ClassVar = ConfigDict(extra="forbid")

    device: str
    device_reason: str
    stages: tuple[Stage, ...]
    accuracy_K: float | None  # estimated error of T_app by the trace; None if nothing scatters
    spray: dict[str, float]
    counts: dict[str, int]
    defines: dict[str, dict[str, Any]]  # kernel file -> its compile-time constants
    precision: str
    integration_time_s: float  # of the sensor, for the standard errors and the rig
    versions: dict[str, str] = field(default_factory=dict)
    spectral: SpectralInfo | None = None  # spectral resolution of the filter
    closure: EnergyBalance | None = None  # difference of the sum of weights from 1
    remarks: tuple[str, ...] = ()  # inferences, and deviations from the request
    phase: str = ""  # phase function of the droplets
    files: tuple[FileRead, ...] = ()  # that the spray was read from
    errors: Errors | None = None  # of T_app, by source; None without audit
    integrals: tuple[dict[str, float], ...] = ()  # over each node's octree, m2, to verify it
    plan: dict[str, Any] | None = None  # resolution and error allocation, plain data
    origin: Origin | None = None  # when, by which command, on what; None in runs of 0.1.0

    def to_json(self) -> str:
        """JSON; `from_dict` takes its content."""
        return json.dumps(self.to_dict(), indent=2)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**asdict(self), "errors": self.errors and self.errors.to_dict()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "RunInfo":
        """Reads the plain `data` of `to_dict`; raises ValueError for other types and keys."""
        # 0.1.0 wrote differences of times, some of which are below 0
        stages = [{**stage, "seconds": max(stage["seconds"], 0.0)} for stage in data["stages"]]
        try:
            return _reader().validate_json(json.dumps({**data, "stages": stages}), strict=True)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, fault["loc"]))
            raise ValueError(f"{where}: {fault['msg']}") from error


@cache
def _reader() -> TypeAdapter[RunInfo]:
    return TypeAdapter(RunInfo)


@dataclass(frozen=True)
class Run(Presented):
    """A simulated run, as `simulate` and `open_run` return it.

    weights, reference: of the traced scene, and of the same scene without spray; (H, W) float32,
        row 0 at the top; emission in photons s-1 m-2 sr-1. For the whole filter: those of several
        spectral nodes are combined by `effective_weights`, for light of
        `quadrature.reference_K` (the middle background).
    spectral: the weights of each node of `quadrature`; (weights,) for a single one.
    maps: DIT of the trace without noise, (H, W), with the standard errors for the scene's sensor
        and number of shots.
    rays: (H, W) number of rays of each pixel, of several traces their mean; None: not recorded.
    error_maps: standard error of T_app, K, (H, W) float32 by source, and `total`; NaN in pixels
        that do not count. Empty without audit. emissivity_error_maps: likewise of emissivity.
    ensemble: statistics of the injections that the run is the mean of; None: there is one.
    measured: DIT of the rig's acquisition, on the sensor's pixels; None before an acquisition.
    folder: where it is stored, if anywhere.
    """

    scene: Scene
    weights: Weights
    reference: Weights
    maps: Maps
    info: RunInfo
    quadrature: Quadrature
    spectral: tuple[Weights, ...]
    error_maps: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    emissivity_error_maps: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    rays: NDArray[np.float32] | None = None
    ensemble: Ensemble | None = None
    measured: Maps | None = None
    folder: Path | None = None

    def __repr__(self) -> str:
        error = "" if self.errors is None else f", error {self.errors.text}"
        place = "in memory" if self.folder is None else f"in {self.folder}"
        return f"<Run {self.scene.name!r}: {self.maps!r}{error}, {place}>"

    def profile(self, **options: Any) -> Profile:
        """T_app and emissivity along a plume, with the errors that the run states; `csv()` of it.

        Args:
            options: of `cldit.dit.profile.profile_of`: start_m and angle_deg.

        Raises:
            EvaluationError: the line does not begin in the image.
        """
        x, _, z = self.scene.target_m
        defaults = {
            "pixel_m": self.pixel_m,
            "centre_m": (x, z),
            "temperature_error_K": self.error_maps.get(TOTAL),
        }
        return profile_of(self.maps, **{**defaults, **options})

    def save(self, folder: str | Path) -> Path:
        """Writes the run into a folder, with its acquisition if it has one.

        Args:
            folder: new or empty; `cldit.open_run` reads it.

        Returns:
            The folder.

        Raises:
            RunFolderError: the folder is not empty.
            FileError: it cannot be written.
        """
        folder = Path(folder)
        if not is_empty(folder):
            raise RunFolderError(f"{folder}: is not empty; allowed: an empty folder, or a new one")
        make_folder(folder)
        if self.measured is not None and self.folder is not None:
            with written(folder):
                shutil.copytree(self.folder / "acquisition", folder / "acquisition")
        save_run(self, folder)
        return folder

    @property
    def errors(self) -> Errors | None:
        """Errors of T_app and emissivity by source; None for a scene without audit."""
        return self.info.errors

    def to_xarray(self, *, measured: bool = False) -> "xarray.Dataset":
        """Maps and weights with coordinates, units and errors; `to_netcdf`, `to_zarr` write them.

        Args:
            measured: True: the maps of the acquisition, on the sensor's pixels, without weights.

        Returns:
            Variables named as the maps' files are, over z and x in mm.

        Raises:
            RunFolderError: the run has no acquisition.
            ClditError: xarray is not installed.
        """
        attrs = {}
        if (origin := self.info.origin) is not None:
            # Without files: an attribute of HDF5 holds 64 kB.
            attrs["origin"] = json.dumps(replace(origin, inputs=()).to_dict())
        if self.errors is not None:
            attrs["errors"] = json.dumps(self.errors.to_dict())
        if not measured:
            return labelled(
                self.scene,
                self.maps,
                pixel_m=self.pixel_m,
                weights=self.weights,
                error_maps=self.error_maps,
                emissivity_error_maps=self.emissivity_error_maps,
                extra_variables={} if self.ensemble is None else self.ensemble.labelled,
                attrs=attrs,
            )
        if self.measured is None:
            raise RunFolderError(
                f"{self.scene.name}: has no acquisition; run it without --trace-only"
            )
        pixel_m = SensorView.from_scene(self.scene).pixel_m
        return labelled(self.scene, self.measured, pixel_m=pixel_m, attrs=attrs)

    @property
    def pixel_m(self) -> tuple[float, float]:
        """Width and height of a traced pixel in the plane of the target."""
        camera = self.scene.camera
        return (camera.field_m[0] / camera.pixels[0], camera.field_m[1] / camera.pixels[1])


def save_run(run: Run, folder: Path) -> None:
    """Writes the run; run.json comes last, with digests of the files that `open_run` reads."""
    make_folder(folder)
    write_text(folder / SCENE_FILE, dump_scene(run.scene))
    run.weights.save(folder / "weights", pixel_m=run.pixel_m)
    save_nodes(folder / "weights", run.quadrature, run.spectral, pixel_m=run.pixel_m)
    run.reference.save(folder / "weights_reference", pixel_m=run.pixel_m)
    run.maps.save(folder / "maps", pixel_m=run.pixel_m)
    save_maps(run.error_maps, folder / "errors", pixel_m=run.pixel_m)
    save_maps(run.emissivity_error_maps, folder / EMISSIVITY_ERRORS, pixel_m=run.pixel_m)
    if run.rays is not None:
        write_image(folder / RAYS, run.rays, name="rays", unit="1", pixel_m=run.pixel_m)
    if run.ensemble is not None:
        run.ensemble.save(folder / STATISTICS, pixel_m=run.pixel_m)
    places = ("weights", "weights_reference", "maps", "errors", STATISTICS)
    files = [file for place in places for file in (folder / place).rglob("*")
             if file.suffix in (".tif", ".json")]  # fmt: skip
    files += [folder / RAYS] if run.rays is not None else []
    write_sealed(folder / "run.json", run.info.to_dict(), [folder / SCENE_FILE, *files])
