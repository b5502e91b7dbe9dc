"""Boundary of the spray, and the measurement equation with windows.

    L_bg = t_r (eps B(T_bg) + (1 - eps) B(T_around)) + e_r B(T_rear window) + r_r B(T_wall)
    I    = t_f L(L_bg, B(T_wall)) + e_f B(T_front window) + r_f B(T_camera side)

L_bg enters the chamber through the rear window: emission of the black body and reflection of its
surroundings, emission of the window, and its reflection of the walls. L leaves the chamber towards
the camera (`compose`), and I is the radiance at the camera. t, r, e are transmission, reflection
and emissivity of a window, t + r + e = 1. Multiple reflections between black body and rear window
are neglected (r_r (1 - eps) of the light, below 1 %). A patch of the enclosure adds to L its weight
times eps B(T) + (1 - eps) B(T_wall), with its own T and eps.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from cldit.arrays import Floats
from cldit.optics.planck import band_radiance
from cldit.optics.response import Filter
from cldit.optics.windows import Pane, band_pane
from cldit.radiance.weights import Weights, background_radiance, compose
from cldit.scene.checks import Section, Within
from cldit.scene.schema import Scene
from cldit.scene.vessel import Patch, Window

Radiance = Callable[[ArrayLike], Floats]


class Uncertainty(Section):
    """Standard uncertainties of quantities that no image shows, for the evaluation's budget."""

    background_calibration_K: Annotated[float, Within(0.0, 100.0)] = 1.0
    """Uncertainty of the black body's calibration, at all set points alike (data sheet)."""
    background_uniformity_K: Annotated[float, Within(0.0, 100.0)] = 0.5
    """Uncertainty of a point of its surface relative to its reading (data sheet)."""
    background_emissivity: Annotated[float, Within(0.0, 0.5)] = 0.01
    """Uncertainty of the black body's emissivity."""
    wall_temperature_K: Annotated[float, Within(0.0, 100.0)] = 1.0
    """Uncertainty of the walls' temperature."""
    window_temperature_K: Annotated[float, Within(0.0, 100.0)] = 1.0
    """Uncertainty of either window's temperature."""
    window_transmission: Annotated[float, Within(0.0, 0.5)] = 0.01
    """Uncertainty of either window's transmission."""
    filter_um: Annotated[float, Within(0.0, 1.0)] = 0.01
    """Uncertainty of the filter's position."""


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """Temperatures and emissivities around the spray, from a scene or a rig file.

    background_surroundings_K: reflected by the black body; None: the walls. windows: at most one
    front and one rear. background_error_K: standard deviation between the black body's temperature
    and its reading, from one set point to the next. camera_offset_error_counts, camera_gain_error:
    likewise of the camera, common to injections and references.
    """

    wall_temperature_K: float
    background_emissivity: float = 1.0
    background_surroundings_K: float | None = None
    camera_surroundings_K: float = 295.0
    windows: tuple[Window, ...] = ()
    patches: tuple[Patch, ...] = ()
    background_error_K: float = 0.0
    camera_offset_error_counts: float = 0.0
    camera_gain_error: float = 0.0
    uncertainty: Uncertainty = field(default_factory=Uncertainty)

    @classmethod
    def from_scene(cls, scene: Scene) -> "Surroundings":
        """The surroundings that a scene describes."""
        return cls(
            wall_temperature_K=scene.walls.temperature_K,
            background_emissivity=scene.background.emissivity,
            background_surroundings_K=scene.background.surroundings_K,
            camera_surroundings_K=scene.camera.surroundings_K,
            windows=scene.windows,
            patches=scene.patches,
        )

    def window(self, side: str) -> Window | None:
        """The window on this side, if there is one."""
        return next((window for window in self.windows if window.side == side), None)


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """The measurement equation in one band; all radiances in photons s-1 m-2 sr-1 of that band.

    radiance: of a black body, as a function of its temperature. wall: of the walls. surroundings:
    of those of the black body. rear_added, front_added: emission and reflection of either window.
    patches: of each patch of the enclosure.
    """

    radiance: Radiance
    wall: float
    emissivity: float
    surroundings: float
    rear: Pane
    rear_added: float
    front: Pane
    front_added: float
    patches: Mapping[str, float] = field(default_factory=dict)

    def leaving(self, blackbody_K: ArrayLike) -> Floats:
        """L_bg for a black body at these temperatures, any shape."""
        emitted = self.radiance(blackbody_K)
        disc = self.emissivity * emitted + (1.0 - self.emissivity) * self.surroundings
        return np.asarray(self.rear.transmission * disc + self.rear_added)

    def seen(self, inside: Floats) -> Floats:
        """Radiance I at the camera for radiances L that leave the chamber, any shape."""
        return np.asarray(self.front.transmission * inside + self.front_added)

    def inside(self, seen: Floats) -> Floats:
        """The inverse of `seen`, any shape."""
        return np.asarray((seen - self.front_added) / self.front.transmission)

    @classmethod
    def of(
        cls, surroundings: Surroundings, radiance: Radiance, pane: Callable[[Window], Pane]
    ) -> "Boundary":
        """Radiances of the surroundings in one band, with the mean shares `pane` of its windows."""

        def at(temperature_K: float) -> float:
            return float(radiance(temperature_K))

        def window(side: str, opposite_K: float) -> tuple[Pane, float]:
            pane_of_window = surroundings.window(side)
            if pane_of_window is None:
                return Pane(), 0.0
            shares = pane(pane_of_window)
            emitted = shares.emission * at(pane_of_window.temperature_K)
            return shares, emitted + shares.reflection * at(opposite_K)

        outside_K = surroundings.background_surroundings_K
        rear, rear_added = window("rear", surroundings.wall_temperature_K)
        front, front_added = window("front", surroundings.camera_surroundings_K)
        wall = at(surroundings.wall_temperature_K)
        return cls(
            radiance=radiance,
            wall=wall,
            emissivity=surroundings.background_emissivity,
            surroundings=at(surroundings.wall_temperature_K if outside_K is None else outside_K),
            rear=rear,
            rear_added=rear_added,
            front=front,
            front_added=front_added,
            patches={
                patch.name: background_radiance(
                    blackbody=at(patch.temperature_K), wall=wall, emissivity=patch.emissivity
                )
                for patch in surroundings.patches
            },
        )

    @classmethod
    def without_windows(cls, surroundings: Surroundings, radiance: Radiance) -> "Boundary":
        """Radiances of the surroundings in one band, as if there were no windows."""
        return cls.of(replace(surroundings, windows=()), radiance, lambda window: Pane())

    @classmethod
    def in_filter(
        cls, surroundings: Surroundings, filter_um: Filter, *, reference_K: float
    ) -> "Boundary":
        """Radiances in a whole filter, with windows' means for a black body at `reference_K`.

        Raises:
            SceneError: the filter reaches beyond the data of a window.
        """
        return cls.of(
            surroundings,
            lambda temperature_K: band_radiance(temperature_K, filter_um=filter_um),
            lambda window: band_pane(window, filter_um, reference_K=reference_K),
        )


def camera_radiance(
    weights: Sequence[Weights], boundaries: Sequence[Boundary], *, background_K: float
) -> Floats:
    """Radiance (H, W) at the camera for one black body; see `camera_radiances`."""
    (image,) = camera_radiances(weights, boundaries, backgrounds_K=[background_K])
    return np.asarray(image)


def camera_radiances(
    weights: Sequence[Weights], boundaries: Sequence[Boundary], *, backgrounds_K: Sequence[float]
) -> Floats:
    """Radiance (K, H, W) at the camera for black bodies of K temperatures.

    It is the sum over bands with weights (H, W) each; parts that do not depend on the background
    are summed once.
    """
    total: Floats | None = None
    for part, boundary in zip(weights, boundaries, strict=True):
        rest = compose(part, background=None, wall=boundary.wall, patches=boundary.patches)
        leaving = boundary.front.transmission * boundary.leaving(np.asarray(backgrounds_K))
        share = part.background.astype(np.float64)
        if total is None:
            total = np.zeros((len(backgrounds_K), *share.shape))
        fixed = boundary.seen(rest)
        for image, radiance in zip(total, leaving, strict=True):
            image += fixed
            image += share * radiance
    if total is None:
        raise ValueError("weights: no band; allowed: one or more")
    return total
