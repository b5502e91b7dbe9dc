"""Apparent temperature T_app from weights, and its error to first order.

A pixel of emissivity 1 - w_bg that receives the radiance L from all but the background has

    B(T_app) = L / (1 - w_bg),
    d T_app  = (d L + B(T_app) d w_bg) / (1 - w_bg) / (dB/dT).

`cldit.dit.fit` finds the same from recorded signals, `script/lines.js` in the viewer's page.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cldit.arrays import Floats, Ints, Mask
from cldit.optics.planck import band_radiance, band_radiance_slope, temperature_of_radiance
from cldit.optics.response import Filter, scene_filter
from cldit.optics.spectral import SpectralNode, reference_temperature_K
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.radiance.weights import Weights, background_radiance, compose
from cldit.scene.schema import Scene


def has_temperature(emissivity: NDArray[np.floating], temperature_K: NDArray[np.floating]) -> Mask:
    """Pixels, any shape, that have a T_app and an emissivity above 0.05."""
    return np.asarray(np.isfinite(temperature_K) & (emissivity > VISIBLE_EMISSIVITY))


def first_order_error_K(
    *,
    radiance: Floats,
    background: NDArray[np.floating],
    apparent: Floats,
    emissivity: NDArray[np.floating],
    slope: Floats,
) -> Floats:
    """Error (N,) of T_app from the errors of L and w_bg, see the module.

    Args:
        radiance: (N,) error of L.
        background: (N,) error of w_bg.
        apparent, emissivity, slope: (N,) B(T_app), 1 - w_bg and dB/dT at T_app.
    """
    return np.asarray((radiance + background * apparent) / emissivity / slope)


def result_errors_K(
    error: Weights,
    *,
    emissivity: NDArray[np.floating],
    temperature_K: NDArray[np.floating],
    scene: Scene,
) -> tuple[Floats, Floats]:
    """Errors (N,) of T_app, and of emissivity times `kelvin_per_emissivity`, from those of weights.

    T_app has an error of 0 in pixels without it.

    Args:
        error: N pixels, for instance half the difference of two independent traces.
        emissivity, temperature_K: of the N pixels, as evaluated.
        scene: with the assumed walls and patches.
    """
    filter_um = scene_filter(scene)
    seen = np.isfinite(emissivity.reshape(-1))
    change = -kelvin_per_emissivity(scene) * error.background.reshape(-1).astype(float)
    emissivity, temperature_K = emissivity.reshape(-1), temperature_K.reshape(-1)
    valid = has_temperature(emissivity, temperature_K)
    black = partial(band_radiance, filter_um=filter_um)
    boundary = Boundary.without_windows(Surroundings.from_scene(scene), black)
    part = error.map(lambda image: image.reshape(-1)[valid])
    known_K = temperature_K[valid].astype(float)
    out = np.zeros(len(valid))
    out[valid] = first_order_error_K(
        radiance=compose(part, background=None, wall=boundary.wall, patches=boundary.patches),
        background=part.background,
        apparent=black(known_K),
        emissivity=emissivity[valid].astype(float),
        slope=band_radiance_slope(known_K, filter_um=filter_um),
    )
    return out, np.where(seen, change, 0.0)


@dataclass(frozen=True)
class TraceTemperature:
    """T_app of weights (C, N) of the C components of a trace, in all of a scene's filter.

    radiances: (C,) of the background (its median temperature), the walls, each patch, and the
        units of what vapour and droplets emit.
    boundaries: number of components that enter from outside, the first ones.
    visible: emissivity above which a pixel has a T_app.
    per_emissivity_K: see `kelvin_per_emissivity`.
    """

    radiances: Floats
    boundaries: int
    filter_um: Filter
    visible: float = VISIBLE_EMISSIVITY
    per_emissivity_K: float = 1.0

    @classmethod
    def of(
        cls, scene: Scene, units: Sequence[float], visible: float = VISIBLE_EMISSIVITY
    ) -> "TraceTemperature":
        """Radiances in a scene; `units` are those of the components that the medium emits."""
        filter_um = scene_filter(scene)
        black = partial(band_radiance, filter_um=filter_um)
        boundary = Boundary.without_windows(Surroundings.from_scene(scene), black)
        background_K = reference_temperature_K(scene.background.temperatures_K)
        background = background_radiance(
            blackbody=float(boundary.radiance(background_K)),
            wall=boundary.wall,
            emissivity=scene.background.emissivity,
        )
        outside = (background, boundary.wall, *boundary.patches.values())
        sources, kelvin = np.array([*outside, *units]), kelvin_per_emissivity(scene)
        return cls(sources, len(outside), filter_um, visible, kelvin)

    def cutoff(self, medium: Floats, *, tolerance_K: float) -> float:
        """Transmission of a line of sight beyond which all light changes T_app by `tolerance_K`.

        By the second law B(T_app), and every source function, is between the radiances of the
        coldest and of the hottest of the walls, the patches and the `medium` (N,). The light beyond
        a transmission t is at most t times the brightest one, and dB/dT rises with T, so that the
        change of T_app is at most t max(B) / (dB/dT of the coldest).
        """
        sources = np.concatenate([self.radiances[1 : self.boundaries], medium])
        brightest = float(sources.max())
        coldest_K = float(temperature_of_radiance(sources.min(), filter_um=self.filter_um))
        if not coldest_K > 0.0:
            return 0.0
        slope = float(band_radiance_slope(coldest_K, filter_um=self.filter_um))
        return tolerance_K * slope / brightest

    def temperature_K(self, weights: NDArray[np.floating]) -> Floats:
        """T_app (N,) of weights (C, N) of pixels that have one."""
        apparent = _sum(self.radiances[1:], weights[1:]) / (1.0 - weights[0])
        return temperature_of_radiance(np.maximum(apparent, 0.0), filter_um=self.filter_um)

    def error_K(
        self,
        weights: NDArray[np.floating],
        error: NDArray[np.floating],
        *,
        outside: float | None = None,
    ) -> Floats:
        """Error (N,) of T_app from an error of the weights; NaN in pixels without.

        A pixel that does not see the background gets the emissivity of one that does: this only
        steers a trace.

        weights, error: (C, N). outside: radiance that replaces that of walls and patches.
        """
        radiances = self.radiances[1:].copy()
        if outside is not None:
            radiances[: self.boundaries - 1] = outside
        emissivity = 1.0 - weights[0]
        apparent = _sum(radiances, weights[1:]) / np.maximum(emissivity, 1e-9)
        out = np.full(weights.shape[1], np.nan)
        valid = (emissivity > self.visible) & (apparent > 0)
        if valid.any():
            known_K = temperature_of_radiance(apparent[valid], filter_um=self.filter_um)
            out[valid] = first_order_error_K(
                radiance=_sum(radiances, error[1:, valid]),
                background=error[0, valid],
                apparent=apparent[valid],
                emissivity=emissivity[valid],
                slope=band_radiance_slope(known_K, filter_um=self.filter_um),
            )
        return out


def _sum(radiances: Floats, weights: NDArray[np.floating]) -> Floats:
    """Sum (N,) of radiances (C,) times weights (C, N).

    Not by BLAS, whose threads keep a core busy for a while after each product.
    """
    return np.asarray(np.einsum("c,cn->n", radiances, weights))


@dataclass(frozen=True)
class NodeTemperature:
    """T_app of weights in one spectral node, by a table of the node's black-body radiance.

    grid_K, radiance: (N,), the table. wall, patches: radiances of the boundary.
    sees_background: (H, W), which lines of sight end on the background. visible: emissivity above
    which a pixel has a T_app. per_emissivity_K: see `kelvin_per_emissivity`.
    """

    grid_K: Floats
    radiance: Floats
    wall: float
    patches: Mapping[str, float]
    sees_background: Mask
    visible: float = VISIBLE_EMISSIVITY
    per_emissivity_K: float = 1.0

    @classmethod
    def of(
        cls,
        scene: Scene,
        node: SpectralNode,
        sees_background: Mask,
        *,
        visible: float = VISIBLE_EMISSIVITY,
    ) -> "NodeTemperature":
        """Tabulates a node; `sees_background` (H, W) has the lines of sight that end on it."""
        grid_K = np.geomspace(20.0, 5000.0, 20_000)
        radiance = np.asarray(node.radiance(grid_K), float)

        def tabulated(temperature_K: ArrayLike) -> Floats:
            return np.asarray(np.interp(np.asarray(temperature_K, float), grid_K, radiance))

        boundary = Boundary.without_windows(Surroundings.from_scene(scene), tabulated)
        outside = boundary.wall, boundary.patches
        kelvin = kelvin_per_emissivity(scene)
        return cls(grid_K, radiance, *outside, sees_background, visible, kelvin)

    def picked(self, pixels: Ints) -> "NodeTemperature":
        """The same for pixels (N,), flat numbers, whose weights are one row (1, N)."""
        return replace(self, sees_background=self.sees_background.reshape(1, -1)[:, pixels])

    def __call__(self, weights: Weights) -> Floats:
        """T_app (H, W); NaN off the background, and where the medium is transparent."""
        added = compose(weights, background=None, wall=self.wall, patches=self.patches)
        emissivity = 1.0 - weights.background.astype(float)
        apparent = np.divide(added, emissivity, out=np.zeros_like(added), where=emissivity > 1e-6)
        # Interpolated between logarithms, whose curve over 1 / T is nearly straight.
        usable = (apparent > self.radiance[0]) & self.sees_background
        inverse = np.interp(
            np.log(np.where(usable, apparent, 1.0)), np.log(self.radiance), -1.0 / self.grid_K
        )
        return np.where(usable, -1.0 / inverse, np.nan)

    def results(self, weights: Weights) -> tuple[Floats, Floats]:
        """T_app, and emissivity times `per_emissivity_K`, (H, W) each; NaN off the background."""
        emissivity = 1.0 - weights.background.astype(float)
        seen = np.where(self.sees_background, self.per_emissivity_K * emissivity, np.nan)
        return self(weights), seen
