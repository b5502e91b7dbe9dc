"""Lattices of the cone that memory holds, by the parcels of one that was made."""

from __future__ import annotations

from dataclasses import replace

from cldit.accuracy.cells import too_many
from cldit.accuracy.plan import Plan
from cldit.prepare.cell_choice import finest_lattice_m
from cldit.prepare.medium import Prepared
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray

_HARDLY = 0.9  # of an edge: cells that are not smaller than that leave nearly the same error


def held(plan: Plan, made: tuple[Scene, Prepared] | None) -> Plan:
    """The plan with a lattice whose parcels fit the memory.

    Args:
        plan: with the lattice that is wanted.
        made: a spray, and the scene that it is of; None: there is none yet.
    """
    if plan.lattice_of_m is None or plan.spacing_m is None or made is None:
        return plan
    scene, prepared = made
    sources, cone = prepared.properties.sources, scene.spray
    if not isinstance(cone, ConeSpray) or sources[0][0] is None:
        return plan
    classes = (plan.size_classes or cone.classes) / cone.classes
    finest_m = finest_lattice_m(
        cone.lattice_m,
        parcels=classes * len(sources[0][0].position_m),
        wavelengths=len(sources),
    )
    if plan.spacing_m >= finest_m:
        return plan
    return replace(plan.on_lattice(finest_m), limited=too_many(plan.spacing_m))


def hardly_finer(better: Plan, than: Plan, made: tuple[Scene, Prepared] | None) -> str:
    """Why the cells of a better plan are not worth a trace; empty: they are.

    Args:
        better: than what was traced.
        than: what was traced.
        made: as in `held`.
    """
    possible = held(better, made)
    if possible is better or possible.spacing_m is None or than.spacing_m is None:
        return ""
    return possible.limited if possible.spacing_m >= _HARDLY * than.spacing_m else ""
