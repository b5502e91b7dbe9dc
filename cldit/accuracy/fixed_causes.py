"""Causes of error that no plan makes smaller, measured on coarse cells before anything is chosen.

They bound what is worth choosing: where they alone err by more than was asked for, cells, ordinates
and wavelengths that add little to them are as good as any finer ones (`Plan.aim_K`). Coarse cells
blur what these causes do, and with it what they are seen to err by.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cldit.accuracy.budget import Budget, foretold_K
from cldit.accuracy.cells import coarse_depths, foretold_error
from cldit.accuracy.errors import Cause
from cldit.accuracy.picture import Picture
from cldit.accuracy.pilot import Pilot
from cldit.accuracy.plan import Plan, cells_are_free, free_causes
from cldit.errors import SprayError, TransportError
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, GridSpray


def fixed_causes(
    scene: Scene,
    pilot: Pilot,
    say: Callable[[str], None],
    *,
    depth: int | None = None,
) -> tuple[Cause, ...]:
    """What a scene errs by whatever is chosen for it, as far as it is known.

    Pixel sampling and, where the scene sets its directions, the trace are told by each picture of a
    pilot (`cldit.accuracy.budget.foretold_K`), and are not among these.

    Args:
        scene: as the user wrote it.
        pilot: traces at one wavelength.
        say: told of each trace.
        depth: of the cells, which were traced already; None: the coarsest that will do.

    Returns:
        Causes whose error is known.
    """
    out = [*_of_cells(scene, pilot)]
    free = free_causes(scene)
    spray, probed = scene.spray, pilot.probed
    keys = isinstance(spray, ConeSpray) and (spray.size_classes or spray.spacing_m)
    if probed.parcels is None and probed.gas is None and not keys:
        return tuple(out)
    for on in coarse_depths(pilot) if depth is None else (depth,):
        budget = Budget(scene, pilot, on + 1, say)
        try:
            pilot.level(on)
            out += [cause for cause, _ in budget.of_sources(on)]
        except (SprayError, TransportError):  # no cone has the lattice, or cells reach too far
            continue
        sized = budget.sized().values() if keys else ()
        out += [one.at(one.size)[0] for one in sized if one.name not in free]
        break
    return tuple(cause for cause in out if cause.error_K is not None)


def foreseen(
    plan: Plan,
    scene: Scene,
    pilot: Pilot,
    picture: Picture,
    say: Callable[[str], None],
) -> Plan:
    """The plan that knows what the finest pilot's picture errs by beside its cells.

    What is fixed is seen on cells twice as large, as it is measured of a picture on the pilot's.

    Args:
        plan: to choose cells by.
        scene, pilot, say: as in `fixed_causes`.
        picture: of the pilot's finest cells.
    """
    fixed = fixed_causes(scene, pilot, say, depth=max(pilot.kept) - 1)
    known = plan.knowing(scene, fixed)
    seen_K = foretold_K(pilot, picture, plan.trace_K)
    return replace(known, foretold_K={**known.foretold_K, **seen_K})


def _of_cells(scene: Scene, pilot: Pilot) -> tuple[Cause, ...]:
    """The error of cells that the scene fixes, foretold by larger ones."""
    if cells_are_free(scene) or isinstance(scene.spray, GridSpray):
        return ()
    error_K, at_most = foretold_error(pilot, pilot.probed.frame.depth)
    return (Cause("cells", error_K, "by larger ones", at_most=at_most),)
