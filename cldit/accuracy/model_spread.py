"""Spread of both results by the model: the lens that a pinhole omits, and the phase function.

The lens is estimated from the pinhole's image, blurred by diffraction at the f-number of the sensor
and by the mean disc of the depths at which droplets or gas are; light of all depths counts as equal
in each pixel. Mie's phase function is compared with isotropic scattering on coarse cells, any other
with Mie's where the droplets have diameters, else with isotropic scattering. Which lens a camera
has, and which phase function is right, is no numerical error: both are stated beside the errors,
and never in their sum.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from cldit.accuracy.errors import Cause, Estimate
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.variant_tracer import VariantTracer, temperature_of
from cldit.arrays import Floats
from cldit.errors import MediumError, SprayError, TransportError
from cldit.medium.resolution import counted
from cldit.optics.scene_phase import has_coefficients, scene_phase
from cldit.prepare.medium import Prepared
from cldit.radiance.point_spread import PointSpread
from cldit.scene.camera import Camera, Lens
from cldit.scene.spray import GridSpray
from cldit.spray.result import Spray
from cldit.transport.phase import PhaseError
from cldit.transport.trace import settings_for

_DEPTHS = 16  # that stand for the distribution of depths


def lens_omission(prepared: Prepared, image: ImagePair) -> tuple[Cause, ...]:
    """Change by a lens, of an `image` (H, W) of a pinhole; none for cameras of another model."""
    scene = prepared.scene
    if scene.camera.lens is not None or scene.camera.model != "pinhole":
        return ()
    camera = scene.camera.model_copy(update={"lens": Lens()})
    radii_m = blur_radii_m(camera, depths_m(prepared.spray) - scene.target_m[1])
    seen = scene.model_copy(update={"camera": camera})
    blurred = PointSpread.of(seen, radii_m)(image.weights)
    temperature = temperature_of(prepared)
    differences = ImageDifference.between(temperature, ImagePair(blurred), ImagePair(image.weights))
    blur = f"f/{camera.sensor.f_number:g} and diffraction"
    method = f"a pinhole's image against one blurred by {blur}; camera.lens traces it"
    spread = Estimate.of("lens", differences, method)
    return (spread.stated(temperature.per_emissivity_K),)


def blur_radii_m(camera: Camera, behind_m: Floats) -> tuple[float, ...]:
    """Radii, in the plane of the target, of the discs of points so far behind it."""
    away_m = np.maximum(camera.distance_m + behind_m, 1e-3 * camera.distance_m)
    sizes = np.abs(camera.distance_m / away_m - camera.distance_m / camera.focus_m)
    return tuple((camera.aperture_m / 2 * sizes).tolist())


def depths_m(spray: Spray) -> Floats:
    """Depths y of equal parts of the droplets' area, of the vapour, or of given coefficients."""
    y, part, cells = np.zeros(1), np.ones(1), None
    if spray.parcels is not None and spray.parcels.droplets.any():
        y = spray.parcels.position_m[:, 1]
        part = spray.parcels.droplets * spray.parcels.diameter_m**2
    elif spray.vapour is not None and spray.vapour.masses_kg.any():
        cells, part = spray.vapour.cells, spray.vapour.masses_kg
    elif (coefficients := spray.prescribed) is not None:
        cells, absorption_per_m = coefficients.cells, coefficients.vapour_absorption_per_m
        absorption_per_m = absorption_per_m + coefficients.droplet_absorption_per_m
        part = (absorption_per_m + coefficients.droplet_scattering_per_m) * cells.volume_m3
    if cells is not None:
        y = (cells.lower_m[:, 1] + cells.upper_m[:, 1]) / 2
    order = np.argsort(y)
    sums = np.cumsum(part[order])
    if not sums[-1] > 0.0:
        return np.zeros(1)
    places = (np.arange(_DEPTHS) + 0.5) / _DEPTHS * sums[-1]
    return np.asarray(y[order][np.searchsorted(sums, places)])


_PHASE = "phase function"
_COARSER = 4.0  # cells over those of the image, at most: the spread is needed to a tenth or so
_LEAST_K = 2.0  # of the second trace, whose noise is separated
_MOST_CELLS = 1e6  # swept: more take longer than most images


def phase_spread(tracer: VariantTracer, cell_m: float) -> Cause:
    """Spread by the phase function of an image on cells of this edge."""
    scene, prepared = tracer.scene, tracer.prepared
    current = scene_phase(scene, prepared.spray, scene.optics.preset)
    prescribed = has_coefficients(prepared.spray)
    if current.mie or (prescribed and not current.isotropic):
        alternative: Literal["isotropic", "mie"] = "isotropic"
    elif prescribed:
        return Cause(_PHASE, None, "not known: the droplets are coefficients without diameters")
    else:
        alternative = "mie"
    if not isinstance(scene.spray, GridSpray):
        larger = (m for m in tracer.levels if m <= _COARSER * cell_m)
        cell_m = max(larger, default=_COARSER * cell_m)
    cells = counted(tracer.frame(cell_m), prepared.sources, prepared.device).swept
    if cells > _MOST_CELLS:
        reason = "not known: a second trace is long; compare a run with transport.phase: "
        return Cause(_PHASE, None, reason + alternative)
    try:
        medium = prepared.rescattered(alternative)
        phase = medium.properties.phases[medium.number]
        least_K = max(tracer.settings.accuracy_K, _LEAST_K)
        settings = settings_for(medium.scene, phase, tolerance_K=least_K)
        varied = replace(
            tracer,
            prepared=medium,
            settings=replace(settings, method="source", audit=False, subpixels=False),
            levels={},
            variants={},
            traces={},
        )
        differences = tracer.difference(tracer.level(cell_m), varied.level(cell_m))
    except (MediumError, PhaseError, SprayError, TransportError) as error:
        return Cause(_PHASE, None, f"not known: {error}")
    method = f"RMS of {current.name} against {alternative}, on cells of {1e3 * cell_m:.3g} mm"
    return Estimate.of(_PHASE, differences, method).stated(tracer.temperature.per_emissivity_K)
