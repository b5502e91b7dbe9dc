"""Fields of a run's octree, leaf by leaf, each with its unit in its name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.gpu.device import Device
from cldit.medium.leaves import Leaves
from cldit.medium.octree import Octree
from cldit.optics.spectral import Quadrature
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run.rebuilt import Rebuilt
from cldit.transport.source_iteration import source_function

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CellFields:
    """Leaves, and their fields (N,) float32 by name.

    extinction, vapour_absorption, droplet_absorption, droplet_scattering, per_m: coefficients.
    albedo_1: scattered share of the extinction. emission: thermal, photons s-1 m-3 sr-1.
    source_function: of all light that leaves the leaf to the camera, photons s-1 m-2 sr-1.
    vapour_temperature, droplet_temperature, K: of the black body that emits as much at the node;
    NaN where the phase does not absorb. wavelength_um: of the node.
    """

    leaves: Leaves
    values: dict[str, NDArray[np.float32]]
    wavelength_um: float

    @classmethod
    def of(cls, made: Rebuilt, quadrature: Quadrature, device: Device) -> CellFields:
        """The fields before the middle background (`quadrature.reference_K`).

        Args:
            made: the medium of a node.
            quadrature: of the run.
            device: solves for the source.

        Raises:
            ClditError: as `source_function`.
        """
        node = quadrature.nodes[made.number]
        bounds = Boundary.of(Surroundings.from_scene(made.scene), node.radiance, node.pane)
        boundary = {
            "background": float(bounds.leaving(quadrature.reference_K)),
            "wall": bounds.wall,
            **bounds.patches,
        }
        source = source_function(made.tree, made.scene, device, made.settings, boundary)
        fields = made.tree.fields
        leaves = Leaves.of(made.tree, [*fields.values(), source])
        at = leaves.address
        values = {name: part[at] for name, part in _optical(made.tree).items()}
        values["source_function_photons_per_s_m2_sr"] = source[at]
        for phase, name in (("vapour", "vapour"), ("droplet", "droplet")):
            values[f"{name}_temperature_K"] = temperature_K(
                fields[f"{phase}_emission"][at], fields[f"{phase}_absorption"][at], node.radiance
            )
        narrow = {name: part.astype(np.float32) for name, part in values.items()}
        return cls(leaves, narrow, node.wavelength_um)


def _optical(tree: Octree) -> dict[str, Floats]:
    fields = {name: values.astype(np.float64) for name, values in tree.fields.items()}
    scattering = fields["droplet_scattering"]
    extinction = fields["vapour_absorption"] + fields["droplet_absorption"] + scattering
    albedo = np.divide(scattering, extinction, out=np.zeros_like(extinction), where=extinction > 0)
    return {
        "extinction_per_m": extinction,
        "albedo_1": albedo,
        "emission_photons_per_s_m3_sr": fields["vapour_emission"] + fields["droplet_emission"],
        "vapour_absorption_per_m": fields["vapour_absorption"],
        "droplet_absorption_per_m": fields["droplet_absorption"],
        "droplet_scattering_per_m": scattering,
    }


def temperature_K(
    emission: NDArray[np.floating],
    absorption: NDArray[np.floating],
    radiance: Callable[[ArrayLike], Floats],
) -> Floats:
    """Temperature of what emits its absorption times a black body's radiance (Kirchhoff), (N,).

    Args:
        emission: (N,) photons s-1 m-3 sr-1.
        absorption: (N,) per metre.
        radiance: of a black body over its temperature.

    Returns:
        K; NaN where nothing is absorbed or emitted.
    """
    grid_K = np.geomspace(20.0, 5000.0, 20_000)
    table = np.log(np.maximum(radiance(grid_K), np.finfo(float).tiny))
    known = (absorption > 0) & (emission > 0)
    black = np.divide(emission, absorption, out=np.ones(len(emission)), where=known)
    # nearly straight: logarithm over 1 / T
    inverse = np.interp(np.log(black), table, -1.0 / grid_K)
    return np.where(known, -1.0 / inverse, np.nan)
