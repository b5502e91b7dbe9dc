"""Files in the folder of a run: their names, the weights of its nodes, maps of errors."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.error_maps import TOTAL
from cldit.errors import ClditError, RunFolderError
from cldit.io.files import make_folder, write_text
from cldit.io.images import read_image, write_image
from cldit.io.plain_data import read_json
from cldit.optics.spectral import Quadrature
from cldit.radiance.weights import Weights

SCENE_FILE, RAYS = "scene.yaml", "rays.tif"
EMISSIVITY_ERRORS = Path("errors", "emissivity")
_QUADRATURE = "quadrature.json"


def save_nodes(
    folder: Path,
    quadrature: Quadrature,
    spectral: Sequence[Weights],
    *,
    pixel_m: tuple[float, float],
) -> None:
    """Writes each node's weights into `folder/node_00`, .., and the description of the nodes.

    A single node has the weights of `folder` itself, and nothing is written.
    """
    if len(spectral) == 1:
        return
    for number, weights in enumerate(spectral):
        weights.save(folder / f"node_{number:02d}", pixel_m=pixel_m)
    description = json.dumps(quadrature.to_dict())
    write_text(folder / _QUADRATURE, description)


def node_folders(folder: Path, grey: Quadrature) -> tuple[Quadrature, tuple[Path, ...]]:
    """The nodes in a folder of weights, and the folder of each one's weights; without nodes, `grey`
    and the folder itself. Raises RunFolderError if the description is damaged.
    """
    path = folder / _QUADRATURE
    if not path.is_file():
        return grey, (folder,)
    try:
        quadrature = Quadrature.from_dict(read_json(path))
    except RunFolderError:
        raise
    except (ValueError, TypeError, KeyError, ClditError) as error:
        raise RunFolderError(f"{path}: is damaged ({error}); trace the run again") from error
    names = tuple(folder / f"node_{number:02d}" for number in range(len(quadrature.members)))
    return quadrature, names


def save_maps(
    maps: Mapping[str, NDArray[np.float32]], folder: Path, *, pixel_m: tuple[float, float]
) -> None:
    """Writes each map of an error as float32 TIFF, `total.tif`, `cells.tif`, .."""
    of, unit = "apparent temperature", "K"
    if folder.name == EMISSIVITY_ERRORS.name:
        of, unit = "emissivity", "1"
    for name, image in maps.items():
        make_folder(folder)
        description = f"standard error of the {of}{'' if name == TOTAL else f' by {name}'}"
        path = folder / f"{name.replace(' ', '_')}.tif"
        write_image(path, image, name=description, unit=unit, pixel_m=pixel_m)


def load_maps(folder: Path) -> dict[str, NDArray[np.float32]]:
    """Reads the files of `save_maps`; nothing without a folder. Raises RunFolderError."""
    files = sorted(folder.glob("*.tif"))
    return {file.stem.replace("_", " "): read_image(file)[0] for file in files}
