"""Error of T_app by light of the walls, and what evaluations gain that know of scattering."""

from __future__ import annotations

import time
from pathlib import Path

import click

from cldit.cli.console import OUT, escaped, plain_errors, say
from cldit.cli.options import device_option
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.scene import load_scene, parse_scene
from cldit.study.page import write_page
from tests.bench.scattering.page import scattering_page
from tests.bench.scattering.run import scattering_study


@click.command()
@click.argument("scene", default="gdi-cone")
@click.option("--out", type=click.Path(path_type=Path), help="Folder; default: scattering.")
@click.option("--markdown", is_flag=True, help="Only Markdown and figures, as for docs.")
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
@device_option
@plain_errors
def main(
    scene: str,
    out: Path | None,
    markdown: bool,
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
    start = time.perf_counter()
    found = scattering_study(chosen, open_device(device), cache=default_cache(), progress=say)
    command = f"python -m tests.bench scattered_light {scene} --pixels {pixels} --leaf {leaf_m:g}"
    command += f" --phase {phase}" if phase else ""
    page = scattering_page(found, command=command, seconds=time.perf_counter() - start)
    path = write_page(page, out or Path("scattering"), markdown_only=markdown)
    for sentence in page.findings:
        OUT.print(f"- {escaped(sentence)}")
    OUT.print(f"{path} ({page.seconds:.0f} s)")
