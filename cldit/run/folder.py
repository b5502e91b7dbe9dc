"""The folder of a run: found again, and read."""

import itertools
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cldit.dit.maps import Maps
from cldit.errors import FileError, RunFolderError, SceneError
from cldit.io.digests import UNVERIFIED, read_sealed
from cldit.io.exclusive import is_empty
from cldit.io.files import natural_order
from cldit.io.images import read_image
from cldit.io.plain_data import read_mapping
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.prepare.stages import Stage
from cldit.radiance.weights import Weights
from cldit.run.ensemble_statistics import STATISTICS, Ensemble
from cldit.run.result import Run, RunInfo
from cldit.run.stored_files import (
    EMISSIVITY_ERRORS,
    RAYS,
    SCENE_FILE,
    load_maps,
    node_folders,
)
from cldit.scene import Scene, parse_scene
from cldit.scene.delays import delay_folder, spray_time_s
from cldit.scene.scatter import members_of
from cldit.scene.spray import CfdSpray

ANOTHER_FOLDER = "give another folder (--out), or remove this one"


def free_folder(preferred: Path, scene: Scene, kept_scene: str = SCENE_FILE) -> Path:
    """The first of `preferred`, `preferred-2`, .. that is empty or has results of the same scene.

    kept_scene: name of the file in which such a folder keeps its scene.
    """
    for number in itertools.count(1):
        folder = preferred if number == 1 else preferred.with_name(f"{preferred.name}-{number}")
        scene_path = folder / kept_scene
        if is_empty(folder):
            return folder
        with suppress(RunFolderError, FileError):
            if scene_path.is_file() and stored_scene(scene_path) == scene:
                return folder
    raise AssertionError


def stored_run(folder: Path, scene: Scene) -> Run | None:
    """The finished run of the same scene in `folder`, if there is one."""
    if is_empty(folder):
        return None
    scene_path = folder / SCENE_FILE
    if not scene_path.is_file():
        raise RunFolderError(f"{folder}: is not empty and holds no run; {ANOTHER_FOLDER}")
    stored = stored_scene(scene_path)
    if stored != scene:
        raise RunFolderError(
            f"{folder}: holds a run of another scene ({stored.name}, or other settings); "
            f"{ANOTHER_FOLDER}"
        )
    if not (folder / "run.json").is_file():
        return None
    run = _traced(folder)
    if getattr(scene.spray, "file", None) is not None and not _as_read(scene, run):
        return None
    if run.info.versions.get("cldit") != version("cldit"):
        return None
    with suppress(RunFolderError):  # a full disk, for instance: they are made again
        run = replace(run, measured=_measured(folder, run.scene))
    return run


def _as_read(scene: Scene, run: Run) -> bool:
    """True if a spray from files would be read again as it was: the scene sets time, nozzle and
    axis, and no file has changed."""
    spray, files = scene.spray, run.info.files
    if not isinstance(spray, CfdSpray):
        return False
    if spray.file.suffix == ".npz":
        files = files[:1]  # the others are those that it was made from
    elif spray.nozzle_m is None or spray.axis is None or not isinstance(spray.time_s, float):
        return False
    return bool(files) and not any(file.change for file in files)


def open_run(path: str | Path) -> Run:
    """Reads a run folder.

    Args:
        path: the folder, as `cldit run` or `cldit.simulate` leave it.

    Returns:
        The run; `measured` if the rig recorded it.

    Raises:
        RunFolderError: the folder is missing, holds no finished run, or is damaged.
    """
    folder = Path(path)
    run = _traced(folder)
    return replace(run, measured=_measured(folder, run.scene))


def _measured(folder: Path, scene: Scene) -> Maps | None:
    """Maps of the acquisition, if any, for several delays those of the scene's own time; raises as
    `open_run`."""
    place = folder / "acquisition" / "maps"
    if len(scene.plan.delays_s) > 1:
        time_s = spray_time_s(scene)
        if time_s is None:
            return None
        place /= delay_folder(time_s)
    if not place.is_dir():
        return None
    maps = Maps.load(place)
    _check_shapes(place, vars(maps), maps.reason.shape)
    return maps


def _traced(folder: Path) -> Run:
    """The run without its acquisition; raises as `open_run`."""
    times = sorted((path.parent for path in folder.glob("*/run.json")), key=natural_order)
    if times and not (folder / "run.json").is_file():
        raise RunFolderError(
            f"{folder}: has the runs of a series; allowed: one of {', '.join(map(str, times))}"
        )
    for name in (SCENE_FILE, "run.json"):
        if not (folder / name).is_file():
            hint = "" if name == SCENE_FILE else "; run the same command again to finish it"
            raise RunFolderError(f"{folder}: holds no finished run ({name} is missing){hint}")
    scene = stored_scene(folder / SCENE_FILE)
    info = _stored_info(folder / "run.json")
    grey = Quadrature.grey(
        scene_filter(scene),
        reference_K=reference_temperature_K(scene.background.temperatures_K),
    )
    quadrature, nodes = node_folders(folder / "weights", grey)
    patches = [patch.name for patch in scene.patches]
    columns, rows = scene.camera.pixels
    folders = (folder / "weights", *nodes, folder / "weights_reference")
    weights, *spectral, reference = (Weights.load(place, patches=patches) for place in folders)
    for place, loaded in zip(folders, (weights, *spectral, reference), strict=True):
        _check_shapes(place, loaded.images, (rows, columns))
    maps = Maps.load(folder / "maps")
    _check_shapes(folder / "maps", vars(maps), (rows, columns))
    members = members_of(scene)
    ensemble = Ensemble.load(folder / STATISTICS, members) if members > 1 else None
    return Run(
        scene=scene,
        weights=weights,
        quadrature=quadrature,
        spectral=tuple(spectral),
        reference=reference,
        maps=maps,
        info=info,
        error_maps=load_maps(folder / "errors"),
        emissivity_error_maps=load_maps(folder / EMISSIVITY_ERRORS),
        rays=read_image(folder / RAYS)[0] if (folder / RAYS).is_file() else None,
        ensemble=ensemble,
        folder=folder,
    )


def stored_scene(path: Path) -> Scene:
    """Scene of a run; raises RunFolderError if it is damaged."""
    try:
        return parse_scene(read_mapping(path), source=str(path), finished=True)
    except SceneError as error:
        message = str(error).removeprefix(f"{path}:").strip()
        raise RunFolderError(f"{path}: is damaged ({message})") from error


def _stored_info(path: Path) -> RunInfo:
    """Metadata of a run; raises RunFolderError if they are incomplete or of other types, or if a
    file of the folder is not as it was written.
    """
    data, verified = read_sealed(path)
    try:
        info = RunInfo.from_dict(data)
        new_remarks = () if verified or UNVERIFIED in info.remarks else (UNVERIFIED,)
        return replace(info, remarks=(*info.remarks, *new_remarks))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise RunFolderError(f"{path}: is damaged ({error})") from error


def _check_shapes(folder: Path, images: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
    """Raises RunFolderError if an image of a run has not the (rows, columns) of its camera."""
    for name, image in images.items():
        if image.shape != shape or len(shape) != 2:
            raise RunFolderError(
                f"{folder / name}.tif: is damaged (shape {image.shape}, expected {shape})"
            )


def with_stages(run: Run, stages: list[Stage], measured: Maps | None) -> Run:
    """Adds the `stages` of an evaluation, and the maps `measured` from an acquisition, to a run."""
    info = replace(run.info, stages=(*run.info.stages, *stages))
    return replace(run, info=info, measured=measured)
