"""Common parts of the sections of the spray verification."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cldit.gpu.device import open_device
from cldit.scene.spray import FlowBox, LagrangianSpray
from tests.unit.spray.flow.references import Found, find


@dataclass(frozen=True)
class Bench:
    """Folder of tables, grid, and function that takes lines of progress."""

    cache: Path
    spacing_m: float
    say: Callable[[str], None]

    def box(self, part: float = 1.0) -> FlowBox:
        """Box with the grid spacing of the page times `part`."""
        return FlowBox(spacing_m=part * self.spacing_m)

    def run(self, label: str, spec: LagrangianSpray) -> Found:
        """Computes the spray `spec` and reports its penetration under `label`."""
        found = find(spec, open_device(), cache=self.cache)
        notes = found.spray.notes
        liquid, vapour = (1e3 * notes[f"{name}_penetration_m"] for name in ("liquid", "vapour"))
        seconds = f"{found.seconds:.0f} s of processor time"
        self.say(f"{label}: liquid {liquid:.1f} mm, vapour {vapour:.1f} mm, {seconds}")
        return found
