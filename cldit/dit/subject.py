"""Signals of a planned measurement of a traced spray, and their errors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.dit.fit import Pair, apparent_radiance, emissivity_gradient, fit_pair, radiance_gradient
from cldit.errors import EvaluationError
from cldit.optics.spectral import Quadrature
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene

_PIXELS = 2000  # a sample of all: its 90 % quantile is good to 1 %


@dataclass(frozen=True, kw_only=True)
class Subject:
    """Weights (1, N) of a sample of pixels of a traced scene, with camera and surroundings.

    spray: of each spectral node. scatter: relative standard deviation of the optical depth of one
    injection. places: (N,) flat numbers of the pixels on the sensor. pixels: number of all pixels
    that they stand for.
    """

    spray: tuple[Weights, ...]
    reference: Weights
    boundaries: tuple[Boundary, ...]
    filter_boundary: Boundary
    curve: Curve
    sensor: SensorModel
    scatter: float
    places: NDArray[np.intp]
    pixels: int

    @classmethod
    def of(
        cls,
        scene: Scene,
        quadrature: Quadrature,
        spectral: Sequence[Weights],
        reference: Weights,
        *,
        least_emissivity: float,
    ) -> "Subject":
        """Sensor pixels that see the background, with at least this emissivity of the spray.

        The trace has `spectral` weights of each node of `quadrature`, and those without spray.
        """
        view = SensorView.from_scene(scene)
        spray = [_seen(view, weights) for weights in spectral]
        bare = _seen(view, reference)
        seen = np.mean([weights.background for weights in spray], axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            emissivity = 1.0 - seen / bare.background
        places = np.flatnonzero((bare.background > 0.999) & (emissivity >= least_emissivity))
        if places.size == 0:
            raise EvaluationError(
                f"no pixel on the background has an emissivity of {least_emissivity:g} or "
                f"more; the largest is {np.nanmax(emissivity, initial=0.0):.3g}"
            )
        chosen = places[np.linspace(0, places.size - 1, min(places.size, _PIXELS)).astype(np.intp)]
        surroundings = Surroundings.from_scene(scene)
        nodes = quadrature.nodes
        return cls(
            spray=tuple(_pixels(weights, chosen) for weights in spray),
            reference=_pixels(bare, chosen),
            boundaries=tuple(Boundary.of(surroundings, n.radiance, n.pane) for n in nodes),
            filter_boundary=Boundary.in_filter(
                surroundings, quadrature.filter_um, reference_K=quadrature.reference_K
            ),
            curve=Curve(filter_um=quadrature.filter_um),
            sensor=SensorModel.from_scene(scene),
            # The simulated rig's lognormal field has a smooth and a common part, sigma each.
            scatter=math.sqrt(2.0) * scene.spray.scatter.optical_depth,
            places=chosen,
            pixels=places.size,
        )

    def of_model(
        self,
        scene: Scene,
        quadrature: Quadrature,
        spectral: Sequence[Weights],
        reference: Weights,
    ) -> "Subject":
        """The same pixels of the same sensor in another scene, with weights as in `of`."""
        view, surroundings = SensorView.from_scene(scene), Surroundings.from_scene(scene)
        filter_um, at_K = quadrature.filter_um, quadrature.reference_K
        return replace(
            self,
            spray=tuple(_pixels(_seen(view, weights), self.places) for weights in spectral),
            reference=_pixels(_seen(view, reference), self.places),
            boundaries=tuple(
                Boundary.of(surroundings, n.radiance, n.pane) for n in quadrature.nodes
            ),
            filter_boundary=Boundary.in_filter(surroundings, filter_um, reference_K=at_K),
            curve=Curve(filter_um=filter_um),
        )

    def signals(self, background_K: float) -> tuple[Floats, Floats]:
        """Radiance (N,) at the camera without and with spray."""
        bare = [self.reference] * len(self.boundaries)
        return (
            camera_radiance(bare, self.boundaries, background_K=background_K)[0],
            camera_radiance(self.spray, self.boundaries, background_K=background_K)[0],
        )

    def exposure(self, hottest_K: float) -> SensorModel:
        """The sensor, exposed so that the hottest background fills 80 % of its range."""
        return self.sensor.exposed_for(float(np.max(self.signals(hottest_K))))

    @property
    def calm(self) -> "Subject":
        """The same without scatter between injections."""
        return replace(self, scatter=0.0)

    def variances(self, backgrounds_K: Sequence[float]) -> Floats:
        """Variances (2, 2, N) of T_app [K^2] and of the emissivity, due to injections and due to
        references, with one of each per background."""
        lines, _ = self._fitted(backgrounds_K)
        kinds = (slice(2, 4), slice(0, 2))
        return np.array(
            [
                [
                    np.einsum("ni,nij,nj->n", row[:, of], lines.covariance[:, of, of], row[:, of])
                    for of in kinds
                ]
                for row in self._gradients(lines)
            ]
        )

    def covariance(self, backgrounds_K: Sequence[float]) -> Floats:
        """Covariance (2, N, 2) of T_app and emissivity, with a shot of each kind per background."""
        lines, _ = self._fitted(backgrounds_K)
        rows = self._gradients(lines)
        return np.asarray(np.einsum("ani,nij,bnj->anb", rows, lines.covariance, rows))

    def observables(self, backgrounds_K: Sequence[float]) -> Floats:
        """T_app, NaN where there is none, and emissivity, (2, N)."""
        lines, _ = self._fitted(backgrounds_K)
        radiance, _ = apparent_radiance(lines)
        kelvin = self.curve.temperature(np.where(radiance > 0.0, radiance, np.nan))
        g, _, s, _ = lines.values.T
        return np.stack([kelvin, 1.0 - s / g])

    def response(self, backgrounds_K: Sequence[float]) -> Floats:
        """Derivatives (2, K, N) of T_app and emissivity by the K signals with spray."""
        lines, variance = self._fitted(backgrounds_K)
        rows = self._gradients(lines)[:, :, 2:]
        of_s, of_c = np.einsum("ani,nij->jan", rows, lines.covariance[:, 2:, 2:])
        x = self.filter_boundary.leaving(backgrounds_K)[:, None]
        part = of_s[:, None] * x + of_c[:, None]
        return np.asarray(part / variance / self.filter_boundary.front.transmission)

    def _gradients(self, lines: Pair) -> Floats:
        """Derivatives (2, N, 4) of T_app and emissivity by the values of the lines."""
        radiance, _ = apparent_radiance(lines)
        slope = self.curve.temperature_slope(np.maximum(radiance, 0.0))
        return np.stack([radiance_gradient(lines) * slope[:, None], emissivity_gradient(lines)])

    def depth_response(self, bare: Floats, spray: Floats) -> Floats:
        """Change (K, N) of the injections' signals by a relative change of the optical depth of 1.

        As in the simulated bench: weights change by (1 - r^g) / (1 - r), r the transmission and
        g = 1 + q.
        """
        slope = (spray[-1] - spray[0]) / (bare[-1] - bare[0])
        gone = np.clip(slope, 1e-9, 1.0 - 1e-9)
        return np.asarray(-gone * np.log(gone) / (1.0 - gone) * (spray - bare))

    def both(self, backgrounds_K: Sequence[float]) -> tuple[Floats, Floats]:
        """Radiance (K, N) at the camera without and with spray."""
        bare, spray = zip(*(self.signals(kelvin) for kelvin in backgrounds_K), strict=True)
        return np.stack(bare), np.stack(spray)

    def _fitted(self, backgrounds_K: Sequence[float]) -> tuple[Pair, Floats]:
        """The lines with one shot of either kind per background, and the variance (K, N) of the
        signals with spray, inside the front window."""
        calibration = self.exposure(max(backgrounds_K)).calibration()
        bare, spray = self.both(backgrounds_K)
        extra = (self.scatter * self.depth_response(bare, spray)) ** 2
        scale = calibration.counts_per_radiance
        calm, varied = (
            calibration.variance_counts2(calibration.counts(seen)) / scale**2
            for seen in (bare, spray)
        )
        transmission = self.filter_boundary.front.transmission
        source = self.filter_boundary.leaving(backgrounds_K)
        calm, varied = calm / transmission**2, (varied + extra) / transmission**2
        lines = fit_pair(
            (source, source),
            (self.filter_boundary.inside(bare), self.filter_boundary.inside(spray)),
            variance=(calm, varied),
            usable=np.ones(bare.shape, bool),
        )
        return lines, varied


def _seen(view: SensorView, weights: Weights) -> Weights:
    return weights.map(lambda image: view.image(image).astype(np.float32))


def _pixels(weights: Weights, places: NDArray[np.intp]) -> Weights:
    return weights.map(lambda image: image.reshape(1, -1)[:, places])


def opaque_errors_K(
    subject: Subject,
    spray_K: Floats,
    backgrounds_K: Sequence[float],
    *,
    emissivity: float,
    shots: int = 1,
    references: int = 1,
) -> Floats:
    """Standard errors (N,) of T_app of absorbing sprays at `spray_K` (N,), without shot scatter.

    Lines of sight end on the background; `shots` and `references` are exposures per background.
    """
    shape = (1, spray_K.size)

    def image(value: Floats | float) -> NDArray[np.float32]:
        return np.broadcast_to(np.asarray(value, np.float32), shape)

    spray = Weights(
        background=image(1.0 - emissivity),
        wall=image(0.0),
        vapour=image(0.0),
        liquid=image(emissivity * subject.curve.radiance(spray_K)),
    )
    bare = Weights(background=image(1.0), wall=image(0.0), vapour=image(0.0), liquid=image(0.0))
    grey = replace(
        subject, spray=(spray,), reference=bare, boundaries=(subject.filter_boundary,), scatter=0.0
    )
    injections, bare_ones = grey.variances(backgrounds_K)[0]
    return np.asarray(np.sqrt(injections / shots + bare_ones / references))


def coldest_K(
    subject: Subject,
    backgrounds_K: Sequence[float],
    *,
    error_K: float,
    emissivity: float,
    shots: int = 1,
    references: int = 1,
) -> float:
    """The coldest spray [K] with a standard error of T_app up to `error_K`; NaN: none."""
    sprays_K = np.linspace(200.0, max(backgrounds_K), 2001)
    errors = opaque_errors_K(
        subject, sprays_K, backgrounds_K, emissivity=emissivity, shots=shots, references=references
    )
    resolved = np.flatnonzero(errors <= error_K)
    return float(sprays_K[resolved[0]]) if resolved.size else math.nan
