"""Spread of T_app by the phase function: the coarse image with another model of it.

Mie's phase function is compared with isotropic scattering, any other with Mie's where the droplets
have diameters, else with isotropic scattering. Which is right is a question of the model, as that
of n and k is, so the spread is stated beside the errors and never in their sum.
"""

from __future__ import annotations

from dataclasses import replace

from cldit.accuracy.errors import NO_PIXEL, Cause
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import swept_cells
from cldit.optics.scene_phase import has_coefficients, scene_phase
from cldit.scene.spray import GridSpray
from cldit.transport.phase import PhaseError
from cldit.transport.trace import settings_for

NAME = "phase function"
_COARSER = 2  # halvings fewer than those of the image: the spread is needed to a tenth or so
_LEAST_K = 2.0  # of the second trace, whose noise is separated
_MOST_CELLS = 1e6  # swept: more take longer than most images


def phase_spread(tracer: VariantTracer, depth: int) -> Cause:
    """Spread by the phase function of an image in a cube that is halved `depth` times."""
    scene, prepared = tracer.scene, tracer.prepared
    now = scene_phase(scene, prepared.spray, scene.optics.preset)
    given = has_coefficients(prepared.spray)
    if now.mie or (given and now.asymmetry):
        other = "isotropic"
    elif given:
        return Cause(NAME, None, "not known: the droplets are coefficients without diameters")
    else:
        other = "mie"
    if not isinstance(scene.spray, GridSpray):
        depth = max(depth - _COARSER, 0)
    if swept_cells(prepared.cube.at(depth), prepared.sources) > _MOST_CELLS:
        why = f"not known: a second trace is long; compare a run with transport.phase: {other}"
        return Cause(NAME, None, why)
    changed = scene.with_(**{"transport.phase": other})
    try:
        medium = prepared.rescattered(mie=other == "mie")
        phase = medium.properties.phases[medium.number]
        settings = settings_for(
            changed, phase, tolerance_K=max(tracer.settings.accuracy_K, _LEAST_K)
        )
        second = replace(
            tracer,
            scene=changed,
            settings=replace(settings, method="source", audit=False, subpixels=False),
            prepared=medium,
            levels={},
            variants={},
            earlier={},
        )
        found = tracer.difference(tracer.level(depth), second.level(depth))
    except (MediumError, PhaseError, SprayError, TransportError) as error:
        return Cause(NAME, None, f"not known: {error}")
    if found.error_K is None:
        return Cause(NAME, None, f"not known: {NO_PIXEL}")
    cell_mm = 1e3 * prepared.cube.at(depth).cell_m
    how = f"RMS of {now.name} against {other}, on cells of {cell_mm:.3g} mm"
    return Cause(NAME, found.error_K, how)
