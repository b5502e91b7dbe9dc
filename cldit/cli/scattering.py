"""`cldit scattering`: what an evaluation gains that knows about scattering, on simulated truth."""

from __future__ import annotations

from pathlib import Path

import click
from rich.markdown import Markdown

from cldit.cli.console import OUT, plain_errors, say
from cldit.gpu.device import open_device
from cldit.run.simulate import default_cache
from cldit.scene import load_scene, parse_scene
from cldit.study.scattering.page import scattering_picture, scattering_table
from cldit.study.scattering.run import scattering_study


@click.command("scattering")
@click.argument("scene", default="gdi")
@click.option("--out", type=click.Path(path_type=Path), help="Folder; runs/SCENE-scattering.")
@click.option("--pixels", type=click.IntRange(16, 4096), default=200, show_default=True)
@click.option(
    "--leaf",
    "leaf_m",
    type=click.FloatRange(1e-5, 0.1),
    default=1e-3,
    show_default=True,
    help="Finest cell, m; truth and models share it.",
)
@click.option("--phase", type=click.Choice(["isotropic", "mie"]), help="How droplets scatter.")
@click.option("--device", help="OpenCL device: platform:device, or part of its name.")
@plain_errors
def scattering_command(
    scene: str,
    out: Path | None,
    pixels: int,
    leaf_m: float,
    phase: str | None,
    device: str | None,
) -> None:
    """Evaluate SCENE, traced, in arrangements of walls, plates, discs and filters, and with right
    and wrong models of its spray."""
    data = load_scene(scene).model_dump(mode="json")
    data["camera"]["pixels"] = [pixels, pixels]
    data["domain"]["leaf_edge_m"] = leaf_m
    data["transport"]["phase"] = phase or data["transport"]["phase"]
    chosen = parse_scene(data)
    found = scattering_study(chosen, open_device(device), cache=default_cache(), progress=say)
    folder = out or Path("runs") / f"{chosen.name}-scattering"
    folder.mkdir(parents=True, exist_ok=True)
    table = scattering_table(found)
    (folder / "scattering.md").write_text(table, encoding="utf-8")
    (folder / "scattering.png").write_bytes(scattering_picture(found))
    OUT.print(Markdown(table))
    OUT.print(
        f"the droplets emit more than the vapour in {100 * found.wet:.0f} % of the pixels\n"
        f"{folder / 'scattering.md'}\n{folder / 'scattering.png'}"
    )
