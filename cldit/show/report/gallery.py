"""Page of scenes: figure, command, seconds and stated error of each."""

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.gpu.device import Device
from cldit.run import Say, simulate
from cldit.scene import load_scene
from cldit.show.figures.plot import plot
from cldit.show.figures.style import png_of
from cldit.show.page import Block, Code, Figure, Page, Section, write_page

_ABOUT = (
    "Made by `cldit gallery`. The core seconds are those of one run on `{device}`, including what "
    "was not yet in the cache: tables of droplets and vapour, computed sprays. The error is that "
    "which the run states for its image ([definition](errors.md))."
)


def write_gallery(
    names: Sequence[str],
    folder: Path,
    *,
    options: str,
    changes: dict[str, object],
    device: Device,
    progress: Say | None = None,
) -> Path:
    """Simulates scenes one after the other and writes `gallery.md` with a figure of each.

    Args:
        names: of scenes, as for `cldit run`.
        folder: of the page; its folder `gallery` gets the figures.
        options: of `cldit run`, in the commands on the page.
        changes: effect of the options, as for `Scene.with_`.
        progress: called with lines of text.
    """
    scenes = [(name, load_scene(name).with_(**changes)) for name in names]
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
