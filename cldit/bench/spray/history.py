"""What the sections of the verification's page share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cldit.bench.spray.references import Found, find
from cldit.scene.spray import FlowBox, LagrangianSpray


@dataclass(frozen=True)
class Bench:
    """What the sections share: folder of tables, grid, and where progress is told."""

    cache: Path
    spacing_m: float
    say: Callable[[str], None]

    def box(self, part: float = 1.0) -> FlowBox:
        """The box, its grid spaced by a part of the page's."""
        return FlowBox(spacing_m=part * self.spacing_m)

    def run(self, label: str, spec: LagrangianSpray) -> Found:
        """Computes the spray `spec`, and says how far it came under `label`."""
        found = find(spec, cache=self.cache)
        notes = found.spray.notes
        liquid, vapour = (1e3 * notes[f"{name}_penetration_m"] for name in ("liquid", "vapour"))
        seconds = f"{found.seconds:.0f} s of processor time"
        self.say(f"{label}: liquid {liquid:.1f} mm, vapour {vapour:.1f} mm, {seconds}")
        return found


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table in Markdown, `rows` below their `heading`."""
    lines = [list(heading), ["---"] * len(heading), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]
