"""The folder of a run: written, found again, read."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import yaml

from cldit.dit.maps import Maps
from cldit.errors import RunFolderError
from cldit.files import make_folder, write_text
from cldit.optics.response import scene_filter
from cldit.optics.spectral import Quadrature, reference_temperature_K
from cldit.radiance.weights import Weights
from cldit.run.result import Run, RunInfo, Stage
from cldit.run.spectral import (
    node_folders,
    save_nodes,
)
from cldit.scene import Scene, dump_scene, parse_scene


def save_run(run: Run, folder: Path) -> None:
    """Writes the run; run.json comes last, so that a folder with it is whole."""
    make_folder(folder)
    write_text(folder / "scene.yaml", dump_scene(run.scene))
    run.weights.save(folder / "weights", pixel_m=run.pixel_m)
    save_nodes(folder / "weights", run.quadrature, run.spectral, pixel_m=run.pixel_m)
    run.reference.save(folder / "weights_reference", pixel_m=run.pixel_m)
    run.maps.save(folder / "maps", pixel_m=run.pixel_m)
    write_text(folder / "run.json", run.info.to_json())


def stored_run(folder: Path, scene: Scene) -> Run | None:
    """The finished run of this very scene in `folder`, if there is one.

    Raises:
        RunFolderError: the folder holds something else.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return None
    known = folder / "scene.yaml"
    if not known.is_file():
        raise RunFolderError(f"{folder}: is not empty and holds no run; give another folder")
    before = parse_scene(
        yaml.safe_load(known.read_text(encoding="utf-8")), source=str(known), finished=True
    )
    if before != scene:
        raise RunFolderError(
            f"{folder}: holds a run of another scene ({before.name}, or other settings); give "
            "another folder, or remove this one"
        )
    if getattr(scene.spray, "file", None) is not None or not (folder / "run.json").is_file():
        return None
    run = open_run(folder)
    return run if run.info.versions.get("cldit") == version("cldit") else None


def open_run(path: str | Path) -> Run:
    """Reads a run folder.

    Raises:
        RunFolderError: the folder is missing, holds no finished run, or is damaged.
    """
    folder = Path(path)
    for name in ("scene.yaml", "run.json"):
        if not (folder / name).is_file():
            hint = "" if name == "scene.yaml" else "; run the same command again to finish it"
            raise RunFolderError(f"{folder}: holds no finished run ({name} is missing){hint}")
    text = (folder / "scene.yaml").read_text(encoding="utf-8")
    scene = parse_scene(yaml.safe_load(text), finished=True)
    measured = folder / "acquisition" / "maps"
    try:
        info = RunInfo.from_json((folder / "run.json").read_text(encoding="utf-8"))
    except (ValueError, TypeError, KeyError) as error:
        raise RunFolderError(f"{folder / 'run.json'}: is damaged ({error})") from error
    grey = Quadrature.grey(
        scene_filter(scene),
        reference_K=reference_temperature_K(scene.background.temperatures_K),
    )
    quadrature, nodes = node_folders(folder / "weights", grey)
    patches = [patch.name for patch in scene.patches]
    return Run(
        scene=scene,
        weights=Weights.load(folder / "weights", patches=patches),
        quadrature=quadrature,
        spectral=tuple(Weights.load(node, patches=patches) for node in nodes),
        reference=Weights.load(folder / "weights_reference", patches=patches),
        maps=Maps.load(folder / "maps"),
        info=info,
        measured=Maps.load(measured) if measured.is_dir() else None,
        folder=folder,
    )


def with_stages(run: Run, stages: list[Stage], measured: Maps) -> Run:
    """The `run` with the maps `measured` and the `stages` of an acquisition added.

    Args:
        run: a traced run.
        stages: those of the evaluation.
        measured: maps (H, W) of the acquisition.
    """
    info = replace(run.info, stages=(*run.info.stages, *stages))
    return replace(run, info=info, measured=measured)
