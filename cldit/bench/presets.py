"""`cldit bench presets`: by which of its properties the preset `spectral` differs from `paper`.

A property is switched by the files that users bring: a liquid of the paper's n and k at every
wavelength, a vapour of its cross section at every wavenumber.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cldit.accuracy.spectral import Difference
from cldit.errors import SceneError
from cldit.gpu.device import Device
from cldit.io.files import write_text
from cldit.optics.response import edges_um, scene_filter
from cldit.run import simulate
from cldit.scene import Scene, parse_scene

LIQUID, VAPOUR, PHASE = "liquid over the filter", "vapour over the filter", "Mie's phase function"
CAUSES = (LIQUID, VAPOUR, PHASE)
STEPS: tuple[tuple[str, ...], ...] = (
    (LIQUID,),
    (VAPOUR,),
    (PHASE,),
    (LIQUID, VAPOUR),
    (LIQUID, PHASE),
    (VAPOUR, PHASE),
    CAUSES,
)
_M2_MOL_OF_CM2 = 6.02214076e19  # cm2 a molecule


@dataclass(frozen=True)
class Step:
    """What of `CAUSES` was taken from `spectral`, and what that changes from `paper`."""

    taken: tuple[str, ...]
    nodes: int
    difference: Difference


def compare_presets(
    scene: Scene,
    *,
    pixels: int,
    accuracy_K: float,
    device: Device,
    cache: Path | None = None,
    say: Callable[[str], None],
) -> list[Step]:
    """Compares every combination of the causes with none.

    Args:
        scene: with a spray.
        pixels: of the picture, a side.
        accuracy_K: of the traces.
        device: to trace on.
        cache: folder of tables; None keeps nothing.
        say: takes lines of progress.

    Returns:
        A step for each combination.

    Raises:
        SceneError: no pixel shows the spray.
    """
    with tempfile.TemporaryDirectory() as name:

        def run(taken: tuple[str, ...]) -> Scene:
            return variant(scene, taken, Path(name), pixels=pixels, accuracy_K=accuracy_K)

        base = simulate(run(()), device=device, cache=cache).maps
        found = []
        for taken in STEPS:
            other = simulate(run(taken), device=device, cache=cache)
            difference = Difference.of(other.maps, base)
            if difference is None:
                raise SceneError(f"{scene.name}: no pixel shows the spray in both presets")
            found.append(Step(taken, len(other.quadrature.nodes), difference))
            say(f"{', '.join(taken)}: {difference.mean_K:.1f} K")
    return found


def variant(
    scene: Scene, taken: tuple[str, ...], folder: Path, *, pixels: int, accuracy_K: float
) -> Scene:
    """The scene with some properties from `spectral` and the rest as in `paper`, by files.

    Args:
        scene: with a spray.
        taken: from `spectral`.
        folder: for the files.
        pixels: of the picture, a side.
        accuracy_K: of the trace.
    """
    data = scene.model_dump(mode="json")
    optics = data["optics"]
    optics.update(preset="spectral" if taken else "paper", compare_paper=False)
    if LIQUID not in taken:
        optics["liquid"] = str(_grey_liquid(scene, folder))
    if VAPOUR not in taken:
        optics["vapour"] = str(_grey_vapour(scene, folder))
    data["transport"].update(phase="mie" if PHASE in taken else "isotropic", accuracy_K=accuracy_K)
    data["camera"]["pixels"] = [pixels, pixels]
    return parse_scene(data, source="bench")


def _grey_liquid(scene: Scene, folder: Path) -> Path:
    path = folder / "paper.csv"
    n, k = scene.optics.n, scene.optics.k
    write_text(path, f"wavelength_um,n,k\n0.2,{n!r},{k!r}\n50,{n!r},{k!r}\n")
    return path


def _grey_vapour(scene: Scene, folder: Path) -> Path:
    """Writes HITRAN's form, from a little below to a little above the filter."""
    path = folder / "paper.xsc"
    low, high = edges_um(scene_filter(scene))
    value = scene.optics.vapour_m2_mol / _M2_MOL_OF_CM2
    head = f"{'paper':>20}{0.99e4 / high:10.3f}{1.01e4 / low:10.3f}{10:7d}{300.0:7.1f}{760.0:6.1f}"
    write_text(path, f"{head}{value:10.3E}\n{10 * f'{value:10.3E}'}\n")
    return path
