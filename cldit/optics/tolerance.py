"""The ratio of the tolerances of T_app and emissivity, by which their errors are compared."""

from cldit.optics.planck import band_radiance, band_radiance_slope
from cldit.optics.response import scene_filter
from cldit.scene.schema import Scene


def kelvin_per_emissivity(scene: Scene) -> float:
    """Kelvin of T_app that count as much as a unit of emissivity.

    Where the scene sets no tolerance of emissivity, an error of it counts as the change of T_app
    that it makes to first order. A pixel that receives the radiance L from all but the background
    has B(T_app) = L / emissivity, and at constant L

        d T_app = -B(T_app) / (dB/dT) d emissivity / emissivity,

    here of an opaque medium as warm as the coldest background.
    """
    spec = scene.transport
    if spec.accuracy_emissivity is not None:
        return spec.accuracy_K / spec.accuracy_emissivity
    filter_um, coldest_K = scene_filter(scene), min(scene.background.temperatures_K)
    slope = band_radiance_slope(coldest_K, filter_um=filter_um)
    return float(band_radiance(coldest_K, filter_um=filter_um) / slope)
