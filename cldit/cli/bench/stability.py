"""`cldit bench stability`: stiff and extreme cases of the transport."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import click

from cldit.bench.stability import bench_stability, page
from cldit.bench.stability_case import Bench
from cldit.bench.stability_extremes import bench_extremes, extremes
from cldit.bench.stability_known import cases
from cldit.bench.stability_slabs import bench_slabs, need_discrete_ordinates, slabs
from cldit.cli.console import OUT, plain_errors, say
from cldit.cli.units import device_option
from cldit.errors import TransportError
from cldit.gpu.device import open_device
from cldit.io.files import write_text
from cldit.io.terminal import tell


@click.command("stability")
@click.option("--out", type=click.Path(path_type=Path), help="Markdown file; else printed.")
@device_option
@plain_errors
def bench_stability_command(out: Path | None, device: str | None) -> None:
    """Stiff and extreme cases of the transport, with the error that each reaches.

    Takes half an hour, and 5 GB of memory for the case of 1e7 cells. Needs PythonicDISORT.
    """
    need_discrete_ordinates()
    opened = open_device(device)
    outcomes = bench_stability(opened, cases(), say=say)
    with TemporaryDirectory(prefix="cldit-stability-") as place:
        bench = Bench(opened, Path(place))
        media = bench_extremes(bench, extremes(), say=say)
        layers = bench_slabs(bench, slabs(), say=say)
    command = "cldit bench stability --out docs/stability.md"
    text = page(outcomes, media, layers, opened, command=command)
    if out is None:
        tell(text)
    else:
        write_text(out, text)
        OUT.print(str(out))
    missed = [outcome.case.name for outcome in outcomes if not outcome.holds]
    missed += [outcome.name for outcome in media if not outcome.holds]
    missed += [str(outcome.slab) for outcome in layers if not outcome.holds]
    if missed:
        raise TransportError(
            f"bounds or stated errors are missed in {len(missed)} cases: {'; '.join(missed)}"
        )
