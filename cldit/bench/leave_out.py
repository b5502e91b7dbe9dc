"""What it saves to leave out of the kernels what a scene does not need, and to skip empty space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cldit.bench.case import Case, Say, changed, clocked
from cldit.bench.error import path_settings
from cldit.bench.kernels import Kernels
from cldit.bench.report import Part, Table, number
from cldit.medium.octree import Octree, build_octree
from cldit.optics.scene_phase import henyey_greenstein
from cldit.radiance.effective import effective_weights
from cldit.transport.cells import Needs
from cldit.transport.phase import ScatteringTable

_NONE = Needs(vapour=False, droplets=False, scattering=False)
_VAPOUR = replace(_NONE, vapour=True)
_DROPLETS = replace(_NONE, droplets=True)
_SCATTERING = replace(_NONE, scattering=True)


@dataclass(frozen=True)
class Saving:
    """core_s of the same work without the part and with it, where the scene does not need it."""

    part: str
    scene: str
    work: str
    without_s: float
    with_s: float


def leave_out(case: Case, *, say: Say, directions: int = 6) -> Part:
    """Measures every part on a variant of the scene that has no use for it.

    Args:
        case, say: with the scene; takes lines of progress.
        directions: swept.
    """
    tree = case.tree
    gas = _tree(case, _without(tree, "droplet"))
    drops = _tree(case, _without(tree, "vapour"))
    absorbing = _tree(case, _without(tree, "droplet_scattering"))
    found: list[Saving] = []

    def add(saving: Saving) -> None:
        found.append(saving)
        say(f"{saving.part}, {saving.work}: {saving.with_s / saving.without_s:.2f} times")

    def both(part: str, scene: str, some: Case, needs: Needs, *, sweep: bool) -> None:
        lean, full = Kernels(some), Kernels(some, compiled_in=needs)
        add(Saving(part, scene, "image", lean.image().core_s, full.image().core_s))
        if sweep:
            work = f"{directions} sweeps"
            cost = lean.sweep(directions).core_s, full.sweep(directions).core_s
            add(Saving(part, scene, work, *cost))

    scatters = Kernels(case).cells.needs.scattering
    both("droplets", "vapour alone", gas, _DROPLETS, sweep=False)
    both("vapour", "droplets alone", drops, _VAPOUR, sweep=scatters)
    both("scattering", "droplets that only absorb", absorbing, _SCATTERING, sweep=False)
    if scatters:
        _phase(case, directions, add)
    _disc(case, directions if scatters else 0, add)
    _spectral(case, add)
    _empty_space(case, add)
    table = Table.of(
        ("part", "scene without it", "work", "left out, core-s", "compiled in, core-s", "times"),
        [
            (
                s.part,
                s.scene,
                s.work,
                number(s.without_s),
                number(s.with_s),
                number(s.with_s / s.without_s),
            )
            for s in found
        ],
    )
    empty, filled, seen = _pixels(case)
    return Part(
        name="leave-out",
        title=f"What is left out, and what that saves: {case.scene.name}",
        tables=(table,),
        data={
            "savings": [vars(s) for s in found],
            "pixel_core_s": {"empty": empty, "filled": filled, "filled_share": seen},
        },
        text=(
            "Each part is compiled in by force where nothing needs it (the same answers), or left "
            "out as runs do. There is no spectral loop in any kernel: a wavelength is a trace, so "
            "with one there is nothing to leave out but the sum over nodes, which is timed.",
            f"A pixel that sees nothing costs {empty * 1e9:.0f} core-ns in the image kernel, one "
            f"that sees something {filled * 1e9:.0f}: the picture without the spray, and the rest "
            f"of the picture with it divided among the {100 * seen:.1f} % of pixels that meet it. "
            "Pixels that scatter nothing take no samples in `path`, and none is swept for.",
        ),
    )


def _tree(case: Case, tree: Octree) -> Case:
    return replace(case, medium=replace(case.medium, trees=[tree]))


def _without(tree: Octree, prefix: str) -> Octree:
    fields = {
        name: np.zeros_like(values) if name.startswith(prefix) else values
        for name, values in tree.fields.items()
    }
    return replace(tree, fields=fields)


def _phase(case: Case, directions: int, add: Callable[[Saving], None]) -> None:
    """A table that says isotropic, in the last sweep and in path tracing."""
    kernels, table = Kernels(case), ScatteringTable.of(henyey_greenstein(0.0))
    work = f"{directions} last sweeps"
    plain, tabled = kernels.sweep(directions), kernels.sweep(directions, phase=table)
    add(Saving("phase function", "isotropic scattering", work, plain.core_s, tabled.core_s))
    few = [max(n // 8, 1) for n in case.scene.camera.pixels]
    small = case.seen(changed(case.scene, camera={"pixels": few}))
    settings = path_settings(small, 128, phase="isotropic")
    costs = []
    for one in (settings, replace(settings, phase=table)):
        small.run(one)
        costs.append(min(small.run(one)[1].core_s for _ in range(3)))
    work = f"path, {few[0]} x {few[1]} pixels"
    add(Saving("phase function", "isotropic scattering", work, *costs))


def _disc(case: Case, directions: int, add: Callable[[Saving], None]) -> None:
    """A disc so large that all rays forward meet it, against a background that surrounds all."""
    scene = case.scene
    lean = Kernels(case.seen(changed(scene, background={"shape": "enclosure"})))
    full = Kernels(case.seen(changed(scene, background={"shape": "disc", "radius_m": 99.0})))
    name = "background all round"
    add(Saving("background disc", name, "image", lean.image().core_s, full.image().core_s))
    if directions:
        costs = lean.sweep(directions).core_s, full.sweep(directions).core_s
        add(Saving("background disc", name, f"{directions} sweeps", *costs))


def _spectral(case: Case, add: Callable[[Saving], None]) -> None:
    """The sum over the nodes of two equal ones, beside one picture."""
    nodes = case.medium.properties.chosen.nodes
    node = nodes[len(nodes) // 2]
    few = [max(n // 4, 1) for n in case.scene.camera.pixels]
    small = case.seen(changed(case.scene, camera={"pixels": few}))
    result, cost = small.run(small.settings(order=0))
    _, sum_ = clocked(
        case.device,
        lambda: effective_weights(
            [result.weights] * 2, [node] * 2, background_K=450.0, wall_K=450.0
        ),
    )
    add(
        Saving(
            "spectral loop",
            "one wavelength",
            f"trace of order 0, {few[0]} x {few[1]} pixels",
            cost.core_s,
            cost.core_s + sum_.core_s,
        )
    )


def _empty_space(whole: Case, add: Callable[[Saving], None]) -> None:
    few = [max(n // 4, 1) for n in whole.scene.camera.pixels]
    case = whole.seen(changed(whole.scene, camera={"pixels": few}))
    lean, full = Kernels(case), Kernels(case, defines={"EVERY_CELL": 1})
    name = f"{100 * float((case.tree.directory < 0).mean()):.0f} % of bricks undivided"
    steps = [int(kernels.steps()[0][0].sum()) for kernels in (lean, full)]
    work = f"image, {steps[0] / 1e6:.1f} M steps instead of {steps[1] / 1e6:.1f} M"
    add(Saving("empty space cell by cell", name, work, lean.image().core_s, full.image().core_s))


def _pixels(case: Case) -> tuple[float, float, float]:
    """Core seconds of the image kernel for a pixel that sees nothing, for one that sees something,
    and the share of these."""
    pixels = float(np.prod(case.scene.camera.pixels))
    steps, _ = Kernels(case).steps()
    seen = float((steps[1] > 0).mean())
    whole = Kernels(case).image().core_s
    bare = build_octree(case.tree.frame, None, [], optical_depth_split=1.0)
    empty = Kernels(_tree(case, bare)).image().core_s / pixels
    return empty, (whole - (1 - seen) * pixels * empty) / (seen * pixels), seen
