"""The parts of `cldit bench`, each on its own or one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cldit.bench import ASKED_K, BUDGET_SCENES
from cldit.bench.ablation import ablation
from cldit.bench.budget import budget
from cldit.bench.case import Case, Lattice, Say, changed, halved
from cldit.bench.error import bench_error
from cldit.bench.error_report import error_part
from cldit.bench.growth import growth
from cldit.bench.imports.measure import imports
from cldit.bench.leave_out import leave_out
from cldit.bench.memory import memory
from cldit.bench.mitsuba import renderers
from cldit.bench.orders import bench_orders
from cldit.bench.rays import rays
from cldit.bench.report import Part
from cldit.bench.roofline import roofline
from cldit.bench.solver import solver
from cldit.gpu.device import Device
from cldit.scene import Scene


@dataclass(frozen=True)
class Bench:
    """What is measured, and how much of it.

    lattice: pixels that `path` and the reference trace. samples: of the reference, a pixel.
    accuracies_K: what `source` is asked for. pixels, asked_K, seeds, budget_scenes: of `budget`.
    save: takes a part as far as it has come.
    """

    scene: Scene
    device: Device
    cache: Path
    lattice: Lattice
    samples: int
    accuracies_K: tuple[float, ...]
    say: Say
    save: Callable[[Part], None]
    pixels: int = 100
    asked_K: tuple[float, ...] = ASKED_K
    seeds: int = 1
    budget_scenes: tuple[str, ...] = BUDGET_SCENES

    def case(self, *, mie: bool = False, half: bool = False) -> Case:
        """The case with Mie's phase function (`mie`) or isotropic, at full or `half` resolution."""
        phase = "mie" if mie else "isotropic"
        scene = halved(self.scene) if half else self.scene
        fixed = {"phase": phase, "method": "source", "order": None, "accuracy_K": 0.1}
        scene = changed(scene, transport=fixed)
        return Case.of(scene, self.device, cache=self.cache)


def error(bench: Bench) -> Part:
    """All methods, isotropic and, where droplets have diameters, Mie."""
    droplets = bench.scene.spray.model not in ("none", "grid")
    case = bench.case(mie=droplets)
    rows, truths = [], {}
    for phase in ("isotropic", "mie") if droplets else ("isotropic",):
        some, truths[phase] = bench_error(
            case,
            phase=phase,
            lattice=bench.lattice,
            say=bench.say,
            reference_samples=bench.samples,
            accuracies_K=bench.accuracies_K,
        )
        rows += some
        rows += bench_orders(case, truths[phase], phase=phase, lattice=bench.lattice, say=bench.say)
        bench.save(error_part(bench.scene, rows, truths))
    return error_part(bench.scene, rows, truths)


MEASUREMENTS: dict[str, Callable[[Bench], Part]] = {
    "error": error,
    "growth": lambda bench: growth(bench.case(), cache=bench.cache, say=bench.say),
    "budget": lambda bench: budget(
        bench.device,
        cache=bench.cache,
        say=bench.say,
        pixels=bench.pixels,
        asked_K=bench.asked_K,
        seeds=bench.seeds,
        scenes=bench.budget_scenes,
        save=bench.save,
    ),
    "memory": lambda bench: memory(bench.scene, bench.device, say=bench.say),
    "leave-out": lambda bench: leave_out(bench.case(), say=bench.say),
    "roofline": lambda bench: roofline(bench.case()),
    "solver": lambda bench: solver(bench.case(half=True), say=bench.say),
    "rays": lambda bench: rays(bench.case(), say=bench.say),
    "ablation": lambda bench: ablation(bench.device, cache=bench.cache, say=bench.say),
    "import": lambda bench: imports(bench.say),
    "mitsuba": lambda bench: renderers(bench.case(), say=bench.say),
}
USUAL = tuple(name for name in MEASUREMENTS if name not in ("mitsuba", "ablation", "import"))
