"""The study `models` at a size that takes minutes: coarse gas, and as many pixels as blocks.

python -m tests.bench models_small
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from cldit.io.caches import default_cache
from cldit.run import RunCache
from cldit.study.lab import Lab
from cldit.study.page import write_page
from cldit.study.paper import run_study

SMALL = {
    "camera.pixels": [24, 24],
    "camera.sensor.pixels": [24, 24],
    "spray.box.spacing_m": 2.5e-3,
    "spray.droplets_per_parcel": 2e4,
    "domain.leaf_edge_m": 3e-3,
    "transport.directions": 8,
}


def main() -> None:
    """Writes the page docs/studies/models.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/studies"))
    parser.add_argument("--cache", type=Path, default=default_cache())
    given = parser.parse_args()
    lab = Lab(RunCache(given.cache), quick=True, always=SMALL, say=print)
    page = run_study("models", lab)
    size = ", ".join(f"{key} {value}" for key, value in SMALL.items())
    about = f"{page.about} At full size: `cldit study models`. Reduced here: {size}."
    page = replace(page, about=about, command="python -m tests.bench models_small")
    print(write_page(page, given.out, markdown_only=True, suffix=None))


if __name__ == "__main__":
    main()
