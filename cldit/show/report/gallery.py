"""A page of scenes: picture, command, seconds and stated error of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from cldit.gpu.device import Device
from cldit.io.files import make_folder, write_bytes, write_text
from cldit.run import Say, simulate
from cldit.scene import Scene, load_scene
from cldit.show.figures.plot import plot
from cldit.show.figures.sheet import png_of


@dataclass(frozen=True)
class Shown:
    """A scene of the gallery.

    command: that computes it. seconds: that its simulation took. error: as stated, in words.
    picture: PNG.
    """

    scene: Scene
    command: str
    seconds: float
    error: str
    picture: bytes


def write_gallery(
    names: Sequence[str],
    folder: Path,
    *,
    options: str,
    changes: dict[str, object],
    device: Device,
    progress: Say | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Path:
    """Simulates scenes, one after the other, and writes `gallery.md` with a picture of each.

    Args:
        names: of scenes, as `cldit run` takes them.
        folder: of the page; pictures go into its folder `gallery`.
        options: of `cldit run`, which the page's commands have.
        changes: what `options` do to a scene, as `Scene.with_` takes it.
        device: to trace on.
        progress: called with lines of text.
        clock: seconds.

    Returns:
        The page.

    Raises:
        SceneError: there is no such scene.
        ClditError: as `cldit.simulate` and `cldit.io.files.whole`.
    """
    scenes = [(name, load_scene(name).with_(**changes)) for name in names]
    pictures = folder / "gallery"
    make_folder(pictures)
    shown = []
    for name, scene in scenes:
        if progress is not None:
            progress(name)
        with TemporaryDirectory() as scratch:
            start = clock()
            run = simulate(scene, Path(scratch) / "run", device=device, progress=progress)
            seconds = clock() - start
            error = "not stated" if run.errors is None else run.errors.text
            picture = png_of(plot(run, "maps"))
        write_bytes(pictures / f"{scene.name}.png", picture)
        command = " ".join(["cldit run", name, *options.split()])
        shown.append(Shown(scene, command, seconds, error, picture))
    page = folder / "gallery.md"
    write_text(page, gallery_page(shown, device=device.info.name))
    return page


def gallery_page(shown: Sequence[Shown], *, device: str) -> str:
    """The page as Markdown.

    Args:
        shown: the scenes.
        device: on which they were simulated.
    """
    parts = [
        "# Gallery\n\nMade by `cldit gallery`. Hue is the apparent temperature, saturation the "
        f"emissivity. The seconds are those of one\nrun on `{device}`, with what was not yet in "
        "the cache: tables of droplets and vapour,\ncomputed sprays. The error is the one that the "
        "run states for its picture ([what it is](errors.md)).\n"
    ]
    for one in shown:
        name = one.scene.name
        parts.append(
            f"## {name}\n\n{one.scene.description}.\n\n![{name}: apparent temperature and "
            f"emissivity](gallery/{name}.png)\n\n```sh\n{one.command}\n```\n\n"
            f"{one.seconds:.1f} s; error of T_app: {one.error}.\n"
        )
    return "\n".join(parts)
