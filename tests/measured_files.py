"""A laboratory's shots as files with their measured.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import yaml

from cldit.acquisition.frames import FrameReader
from cldit.acquisition.pictures.source import Source
from tests.laboratory import AROUND, FILTER_UM, Laboratory


def write_measured(folder: Path, made: Laboratory, **more: Any) -> None:
    """The shots as a TIFF a kind and background, and their measured.yaml."""
    folder.mkdir(exist_ok=True)
    backgrounds = []
    for background_K in sorted({shot.background_K for shot in made.recorded.shots}):
        names = {}
        for kind in ("reference", "injection"):
            names[f"{kind}s"] = f"{kind}_{background_K:g}.tif"
            stack = [
                shot.image
                for shot in made.recorded.shots
                if (shot.kind, shot.background_K) == (kind, background_K)
            ]
            tifffile.imwrite(folder / names[f"{kind}s"], np.stack(stack), photometric="minisblack")
        backgrounds.append({"temperature_K": background_K, **names})
    data = {
        "filter_um": list(FILTER_UM),
        "setup": {
            "pixel_m": [1e-4, 1e-4],
            "background_emissivity": AROUND.background_emissivity,
            "wall_temperature_K": AROUND.wall_temperature_K,
            "camera_surroundings_K": AROUND.camera_surroundings_K,
            "windows": [window.model_dump() for window in AROUND.windows],
            "uncertainty": {"wall_temperature_K": 5.0},
        },
        "sensor": {"saturation_counts": 16383},
        "backgrounds": backgrounds,
        **more,
    }
    (folder / "measured.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")


def read_all(source: Source) -> Any:
    """All images (n, rows, columns) of a file."""
    reader = FrameReader()
    try:
        return np.stack([reader.read(source, n) for n in range(len(reader.metadata(source)))])
    finally:
        reader.close()
