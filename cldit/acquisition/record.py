"""An acquisition folder, opened for the evaluation."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from cldit.acquisition.journal import shot_times
from cldit.acquisition.plan import Group, Kind, Plan, Shot, load_plan
from cldit.acquisition.preflight import calibrations_of
from cldit.acquisition.storage import (
    CONFIGURATION,
    JOURNAL,
    PLAN,
    FolderContent,
    load_shot,
    shot_path,
    survey,
)
from cldit.camera.calibration import Calibration
from cldit.errors import ClditError, FileError, RunFolderError
from cldit.io.digests import UNVERIFIED, sha256_of
from cldit.io.plain_data import read_json
from cldit.optics.response import Filter, from_plain
from cldit.radiance.boundary import Surroundings
from cldit.rig.load import Setup
from cldit.scene.checks import describe
from cldit.scene.delays import delay_folder


@dataclass(frozen=True)
class Picture:
    """One kept shot. `background_K` is the mean of the readings before and after it; `background`,
    `delay` and `filter` are indices into the plan's temperatures, delays and filters. time_s,
    stable_s: when it was taken and its background became stable, since 1970, and sha256 of the
    file, if the journal knows.
    """

    id: str
    path: Path
    kind: Kind
    background: int
    background_setpoint_K: float
    background_K: float
    saturated_percent: float
    delay: int = 0
    filter: int = 0
    time_s: float | None = None
    stable_s: float | None = None
    sha256: str = ""


@dataclass(frozen=True)
class Acquisition:
    """Recorded data for the evaluation.

    shots: the kept images in the plan's order. calibrations: of the camera with each filter of the
    shots, by its index in the plan. missing: ids of those still to be taken. centre_m:
    (x, z) of the image's middle, the injector's tip at 0, 0. bad_pixels: (h, w), reported by the
    camera. frame: index of the image of each shot that is loaded. shape: rows and columns.
    configuration: the whole snapshot of the rig. damage: a line for everything damaged and
    excluded.
    """

    folder: Path
    plan: Plan
    configuration: dict[str, Any]
    calibrations: dict[int, dict[str, Any]]
    surroundings: Surroundings
    pixel_m: tuple[float, float]
    centre_m: tuple[float, float]
    bad_pixels: NDArray[np.bool_]
    shape: tuple[int, int]
    shots: tuple[Picture, ...]
    missing: tuple[str, ...]
    frame: int = 0
    damage: tuple[str, ...] = ()

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files that describe the recording; the journal has a checksum of every image."""
        named = (self.folder / name for name in (PLAN, CONFIGURATION, JOURNAL))
        return tuple(path for path in named if path.is_file())

    @property
    def complete(self) -> bool:
        """True if every shot of the plan was taken."""
        return not self.missing

    @property
    def calibration(self) -> dict[str, Any]:
        """Calibration of the camera with the filter of the shots. Raises RunFolderError if they
        have several, because images of different filters are never evaluated together.
        """
        if len(self.calibrations) > 1:
            names = ", ".join(self.plan.filters)
            raise RunFolderError(
                f"{self.folder}: contains images of {len(self.calibrations)} filters ({names}); "
                "allowed: those of one filter, as `cldit evaluate` takes them one after the other"
            )
        return next(iter(self.calibrations.values()))

    @property
    def filter_um(self) -> Filter:
        """Lower and upper wavelength of the camera's filter, or its response."""
        return from_plain(self.calibration["filter_um"])

    @property
    def wall_temperature_K(self) -> float:
        """Temperature of the chamber's walls."""
        return self.surroundings.wall_temperature_K

    @property
    def simulated(self) -> bool:
        """True if any instrument was simulated."""
        devices = self.configuration["devices"].values()
        return any(device["info"].get("simulated", False) for device in devices)

    def of_group(self, group: Group) -> "Acquisition":
        """Copy with the shots of one filter and delay only."""

        def inside(shot: Shot | Picture) -> bool:
            return (shot.filter, shot.delay) == (group.filter, group.delay)

        planned = {shot.id for shot in self.plan.steps() if inside(shot)}
        return replace(
            self,
            shots=tuple(shot for shot in self.shots if inside(shot)),
            calibrations={group.filter: self.calibrations[group.filter]},
            missing=tuple(name for name in self.missing if name in planned),
        )

    def whole(self) -> "Acquisition":
        """Copy without images that cannot be read or differ from their recorded checksum.

        Every image is read, and those excluded are named in `damage`.
        """
        damage: dict[str, str] = {}
        for shot in self.shots:
            try:
                self.load_frames(shot)
            except RunFolderError as error:
                damage[shot.id] = str(error)
        return replace(
            self,
            shots=tuple(shot for shot in self.shots if shot.id not in damage),
            damage=(*self.damage, *damage.values()),
        )

    def load(self, shot: Picture) -> NDArray[np.uint16]:
        """Raw counts (h, w) of the chosen frame, row 0 at the top. Raises RunFolderError if
        missing, damaged, or not the recorded image.
        """
        frames, _ = self.load_frames(shot)
        image: NDArray[np.uint16] = frames[self.frame]
        return image

    def load_frames(self, shot: Picture) -> tuple[NDArray[np.uint16], dict[str, Any]]:
        """All images of a shot (n, h, w), and their metadata. Raises RunFolderError as `load`, or
        if the shape is not the plan's.
        """
        image, meta = load_shot(
            self.folder, shot.id, plan_hash=self.plan.hash(), file_sha256=shot.sha256
        )
        frames = image.reshape(-1, *image.shape[-2:])
        if frames.shape != (self.plan.frames, *self.shape):
            expected = (self.plan.frames, *self.shape)
            raise RunFolderError(f"{shot.path}: shape {frames.shape}, expected {expected}")
        return frames, meta


def maps_folder(folder: Path, delays: Sequence[float], number: int) -> Path:
    """Folder of the maps of one delay, `number` of the plan's `delays`: `maps`, or with several
    delays a folder inside it.
    """
    if len(delays) < 2:
        return folder / "maps"
    return folder / "maps" / delay_folder(delays[number])


def maps_of_group(folder: Path, plan: Plan, group: Group) -> Path:
    """Folder of the maps of a filter and a delay: `maps`, or with several filters `maps/FILTER`,
    with several delays a folder inside these.
    """
    if len(plan.filters) > 1:
        maps = maps_folder(folder, plan.delays, group.delay)
        return folder / "maps" / plan.filters[group.filter] / maps.relative_to(folder / "maps")
    return maps_folder(folder, plan.delays, group.delay)


def acquisition_in(folder: str | Path) -> Path:
    """Acquisition folder of a run's `folder`; any other path unchanged."""
    inner = Path(folder) / "acquisition"
    return inner if inner.is_dir() else Path(folder)


def open_acquisition(folder: str | Path, *, frame: int = 0) -> Acquisition:
    """Opens an acquisition, complete or not; with several filters or delays, the shots of all.

    `frame` selects the image of each shot, from 0. Raises RunFolderError if the folder has no
    acquisition, or files are missing, damaged or foreign.
    """
    folder = Path(folder)
    if not (folder / PLAN).is_file():
        raise RunFolderError(
            f"{folder}: holds no {PLAN}; give the folder that `cldit acquire --out` wrote, or one "
            "with measured.yaml, which `cldit evaluate FOLDER --write-measured FILE` drafts"
        )
    plan = load_plan(folder / PLAN)
    if not 0 <= frame < plan.frames:
        raise RunFolderError(f"{folder}: frame {frame}: allowed: 0..{plan.frames - 1}")
    content = survey(folder, plan, salvage=True)
    configured = _configured(folder, plan)
    verified = _verified(folder, content)
    entries = {**content.adoptable, **content.saved}
    _check_filters(folder, plan, entries)
    return Acquisition(
        folder=folder,
        plan=plan,
        **configured,
        shots=_pictures(folder, plan, entries, shot_times(content.entries)),
        missing=tuple(shot.id for shot in plan.steps() if shot.id not in entries),
        frame=frame,
        damage=(*_damage(folder, content), *(() if verified else (f"{folder}: {UNVERIFIED}",))),
    )


def _configured(folder: Path, plan: Plan) -> dict[str, Any]:
    """The configuration, and the fields of an `Acquisition` that it gives; RunFolderError if it is
    damaged, or of another plan."""
    configuration = read_json(folder / CONFIGURATION)
    if configuration.get("plan_hash") != plan.hash():
        raise RunFolderError(f"{folder / CONFIGURATION}: belongs to another plan; restore it")
    try:
        camera = configuration["devices"]["camera"]["configuration"]
        calibrations = dict(enumerate(calibrations_of(configuration["devices"], plan)))
        for calibration in calibrations.values():
            Calibration.from_dict(calibration)
        setup = Setup.model_validate(configuration["setup"])
        rows, columns = configuration["shape"]
        shape = int(rows), int(columns)
        bad = np.zeros(shape, bool)
        for row, column in camera.get("bad_pixels", []):
            bad[row, column] = True
    except (KeyError, TypeError, ValueError, IndexError, ClditError) as error:
        problem = str(error)
        if isinstance(error, ValidationError):
            problem = describe(Setup, error.errors())
        raise RunFolderError(
            f"{folder / CONFIGURATION}: is damaged ({problem}); restore it"
        ) from error
    return {
        "configuration": configuration,
        "calibrations": calibrations,
        "surroundings": setup.surroundings,
        "pixel_m": setup.pixel_m,
        "centre_m": setup.centre_of(shape),
        "bad_pixels": bad,
        "shape": shape,
    }


def _pictures(
    folder: Path,
    plan: Plan,
    entries: Mapping[str, Mapping[str, Any]],
    times: Mapping[str, tuple[float, float | None]],
) -> tuple[Picture, ...]:
    """Kept shots in the plan's order, by their `entries` and `times` of the journal."""
    unknown = (None, None)
    return tuple(
        Picture(
            id=shot.id,
            path=shot_path(folder, shot.id),
            kind=shot.kind,
            background=shot.background,
            background_setpoint_K=shot.background_K,
            background_K=(entry["background_before_K"] + entry["background_after_K"]) / 2.0,
            saturated_percent=entry["saturated_percent"],
            delay=shot.delay,
            filter=shot.filter,
            time_s=times.get(shot.id, unknown)[0],
            stable_s=times.get(shot.id, unknown)[1],
            sha256=entry.get("file_sha256", ""),
        )
        for shot in plan.steps()
        if (entry := entries.get(shot.id)) is not None
    )


def _check_filters(folder: Path, plan: Plan, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Raises RunFolderError if an image was not recorded with the filter that the plan has."""
    for shot in plan.steps():
        if shot.id in entries:
            recorded, planned = entries[shot.id].get("filter"), plan.filter_name(shot)
            if recorded != planned:
                raise RunFolderError(
                    f"{shot_path(folder, shot.id)}: was recorded with filter {recorded}, planned "
                    f"was {planned}; restore {folder / JOURNAL} and {folder / PLAN}"
                )


def _verified(folder: Path, content: FolderContent) -> bool:
    """False if the journal has no digests; RunFolderError if plan, rig or configuration differ from
    those in it.
    """
    starts = [entry.get("files") for entry in content.entries if entry["event"] == "start"]
    digests = starts[-1] if starts else None
    for name, digest in (digests or {}).items():
        try:
            if sha256_of(folder / name) != digest:
                raise RunFolderError(
                    f"{folder / name}: is damaged: it differs from what {JOURNAL} has; restore it"
                )
        except FileError as error:
            raise RunFolderError(str(error)) from error
    return digests is not None


def _damage(folder: Path, content: FolderContent) -> Iterator[str]:
    if content.damage is not None:
        yield str(content.damage)
    for name in content.torn:
        yield f"{shot_path(folder, name)}: is damaged, and the journal does not know it"
    for name in content.gone:
        yield f"{shot_path(folder, name)}: the journal has it, but the file is missing"
