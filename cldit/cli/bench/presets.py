"""`cldit bench presets`: why preset `spectral` differs from `paper`."""

from __future__ import annotations

import click

from cldit.bench.presets import CAUSES, compare_presets
from cldit.cli.console import OUT, folded_table, plain_errors, say
from cldit.cli.units import KELVIN, device_option
from cldit.gpu.device import open_device
from cldit.run import default_cache
from cldit.scene import load_scene


@click.command("presets")
@click.argument("scene", default="gdi")
@click.option("--pixels", type=click.IntRange(8, 1000), default=250, show_default=True)
@click.option("--accuracy", "accuracy_K", type=KELVIN, default=0.5, show_default=True)
@device_option
@plain_errors
def bench_presets_command(scene: str, pixels: int, accuracy_K: float, device: str | None) -> None:
    """Why preset `spectral` differs from `paper`: liquid, vapour and phase function in turn."""
    steps = compare_presets(
        load_scene(scene),
        pixels=pixels,
        accuracy_K=accuracy_K,
        device=open_device(device),
        cache=default_cache(),
        say=say,
    )
    table = folded_table(*CAUSES, "wavelengths", "T_app, mean K", "RMS K", "emissivity")
    for step in steps:
        marks = ("x" if cause in step.taken else "" for cause in CAUSES)
        d = step.difference
        figures = f"{d.mean_K:.1f}", f"{d.rms_K:.1f}", f"{d.mean_emissivity:.3f}"
        table.add_row(*marks, str(step.nodes), *figures)
    OUT.print(table)
