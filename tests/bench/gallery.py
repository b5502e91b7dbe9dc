"""Page of scenes, docs/gallery.md: figure, command, seconds and stated error of each."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.cli.options import pixels_of
from cldit.gpu.device import Device, open_device
from cldit.run import Say, simulate
from cldit.scene import shipped_scenes
from cldit.scene.load import chosen_scene
from cldit.show.figures.plot import plot
from cldit.show.figures.style import png_of
from cldit.show.page import Block, Code, Figure, Page, Section, write_page

_ABOUT = (
    "Made by `python -m tests.bench gallery`. The core seconds are those of one run on "
    "`{device}`, including what was not yet in the cache: tables of droplets and vapour, computed "
    "sprays. The error is that which the run states for its image ([definition](errors.md))."
)


def write_gallery(
    names: Sequence[str],
    folder: Path,
    *,
    options: str,
    pixels: int | Sequence[int] | None,
    device: Device,
    progress: Say | None = None,
) -> Path:
    """Simulates scenes one after the other and writes `gallery.md` with a figure of each.

    Args:
        names: of scenes, as for `cldit run`.
        folder: of the page; its folder `gallery` gets the figures.
        options: of `cldit run`, in the commands on the page.
        pixels: of the options.
        progress: called with lines of text.
    """
    scenes = [(name, chosen_scene(name, quick=True, pixels=pixels)) for name in names]
    sections = []
    for name, scene in scenes:
        if progress is not None:
            progress(name)
        with TemporaryDirectory() as scratch:
            start = time.process_time()
            run = simulate(scene, Path(scratch) / "run", device=device, progress=progress)
            seconds = time.process_time() - start
            error = "not stated" if run.errors is None else run.errors.text
            png = png_of(plot(run, "maps"))
        caption = f"{scene.name}: apparent temperature and emissivity"
        content: list[Block] = [
            f"{scene.description}.",
            Figure(png, caption, f"gallery/{scene.name}.png"),
            Code(" ".join(["cldit run", name, *options.split()])),
            f"{seconds:.1f} core-s; error of T_app: {error}.",
        ]
        sections.append(Section(scene.name, content))
    page = Page("Gallery", [_ABOUT.format(device=device.info.name), *sections])
    return write_page(page, folder / "gallery.md")


def main(arguments: Sequence[str] | None = None) -> None:
    """Writes the page; each scene is simulated as by `cldit run --quick --trace-only`."""
    parser = argparse.ArgumentParser(prog=sys.argv[0], description=__doc__)
    parser.add_argument("scenes", nargs="*", help="default: all shipped ones")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the page")
    parser.add_argument("--pixels", help="as of `cldit run`; default: 128")
    parser.add_argument("--device", help="index or name of an OpenCL device")
    given = parser.parse_args(arguments)
    pixels = None if given.pixels is None else pixels_of(given.pixels)
    more = "" if pixels is None else f" --pixels {given.pixels}"
    page = write_gallery(
        given.scenes or tuple(shipped_scenes()),
        given.out,
        options=f"--quick{more} --trace-only",
        pixels=pixels,
        device=open_device(given.device),
        progress=print,
    )
    print(page)
