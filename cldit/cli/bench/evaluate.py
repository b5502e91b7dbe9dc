"""`cldit bench evaluate`: the evaluation against known sprays, and its speed."""

from __future__ import annotations

import tempfile
from pathlib import Path

import click

from cldit.bench.evaluation import bench_evaluation
from cldit.bench.evaluation_bias import evaluation_bias
from cldit.cli.console import OUT, folded_table, plain_errors


@click.command("evaluate")
@click.option("--shots", type=click.IntRange(10, 100_000), default=1000, show_default=True)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    default=None,
    help="Where the pictures are written, and removed; that for temporary files.",
)
@plain_errors
def bench_evaluate_command(shots: int, folder: Path | None) -> None:
    """Bias and errors against known sprays; time and memory of SHOTS full frames (640 x 512)."""
    table = folded_table("eps", "T bias / K", "T error / K", "T chi2", "eps bias", "eps chi2")
    last = ""
    for row in evaluation_bias():
        if row.surroundings != last:
            last = row.surroundings
            table.add_section()
            table.add_row(f"surroundings: {last}")
        table.add_row(
            f"{row.emissivity:g}",
            f"{row.bias_K:+.3f}",
            f"{row.error_K:.3f}",
            f"{row.chi2_K:.2f}",
            f"{row.emissivity_bias:+.1e}",
            f"{row.chi2_emissivity:.2f}",
        )
    OUT.print(table)
    with tempfile.TemporaryDirectory(dir=folder, prefix="cldit-bench-") as place:
        result = bench_evaluation(Path(place), shots=shots)
    OUT.print(
        f"{result.shots} shots of 640 x 512 in {result.seconds:.1f} s "
        f"({result.cpu_s:.1f} s of CPU, {result.read_s:.1f} s to read them); "
        f"{result.peak_bytes / 2**20:.0f} MiB at most, "
        f"{result.grown_bytes / 2**20:.0f} MiB more than before"
    )
