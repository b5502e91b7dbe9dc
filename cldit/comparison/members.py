"""Injections that differ: errors of the mean of a few, and of a recording of others.

The mean of n injections has the covariance S / n, with S that of one. An early injection moves all
tips, so that few images describe most of S: its largest principal components are errors that all
pixels share, and the rest counts as independent. S itself is estimated from the n injections. The
sum of squares of a difference along k such components is Hotelling's T^2, that is F with k and
n - k degrees of freedom after division by (n - 1) / (n - k), by which the components are enlarged.

If both are injections of the same spray, each division of all members into sides of these sizes is
as probable as the true one: p is the share of divisions whose statistic is at least as large, with
no assumption on the distribution of injections (Fisher 1935; Good 2005). The statistic is
Hotelling's T^2 of the largest principal components of all members. With the scatter of all members
as the unit, which no division changes, T^2 rises with the squared distance of the two means.
"""

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.comparison.chi_square import LEVEL
from cldit.dit.budget import COMMON, Part, common_parts
from cldit.dit.maps import Maps
from cldit.io.images import read_image
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run import Run
from cldit.run.ensemble import INJECTIONS, member_folder

_MOST = 3  # components, and at most a third of the injections or a quarter of those of both
_SMALL = 0.02  # share of the squares of a component that is left to the rest
_EXACT = 5000  # divisions that are all tried; else so many are drawn


@dataclass(frozen=True)
class Members:
    """Deviations (n, N) of n injections from their mean, in the N pixels `seen` (H, W).

    emissivity, own: of the emissivity and of the radiance that the spray adds. turn: (n, k)
    directions of the principal components.
    """

    run: Run
    maps: Maps
    seen: Mask
    emissivity: Floats
    radiance: Floats
    turn: Floats

    @classmethod
    def of(cls, run: Run, *, recorded: Maps | None = None) -> "Members | None":
        """Injections of a run, on the pixels of its sensor if `recorded`; None: fewer than 3."""
        if run.ensemble is None or run.folder is None or run.ensemble.members < 3:
            return None
        maps = run.maps if recorded is None else recorded
        seen = np.asarray(maps.has_temperature)
        emissivity, radiance = _images(run, seen, on_sensor=recorded is not None)
        return cls.about_mean(run, maps, seen, emissivity, radiance)

    @classmethod
    def about_mean(
        cls, run: Run, maps: Maps, seen: Mask, emissivity: Floats, radiance: Floats
    ) -> "Members":
        """Injections by their values (n, N) in the pixels `seen` of `maps`."""
        emissivity = emissivity - emissivity.mean(axis=0)
        radiance = radiance - radiance.mean(axis=0)
        members = cls(run, maps, seen, emissivity, radiance, np.zeros((len(radiance), 0)))
        weighed = maps.emissivity[seen] * members.kelvin(radiance, emissivity)
        squares, turn = np.linalg.eigh(weighed @ weighed.T)
        order = np.argsort(squares)[::-1][: min(_MOST, len(radiance) // 3)]
        kept = [k for k in order if squares[k] > _SMALL * squares.sum()]
        return replace(members, turn=turn[:, kept])

    @property
    def curve(self) -> Curve:
        """Radiance of a temperature."""
        return Curve(filter_um=self.run.quadrature.filter_um)

    def kelvin(self, radiance: Floats, emissivity: Floats) -> Floats:
        """Change of T_app, that of E / e, by those of E and e: dT = (dE - B(T) de) / (e dB/dT)."""
        light_K = self.maps.apparent_temperature_K[self.seen].astype(float)
        change = radiance - self.curve.radiance(light_K) * emissivity
        return np.asarray(change / (self.maps.emissivity[self.seen] * self.curve.slope(light_K)))

    def image(self, values: Floats) -> Floats:
        """Image (..., H, W) of values (..., N), 0 elsewhere."""
        image = np.zeros((*values.shape[:-1], *self.seen.shape))
        image[..., self.seen] = values
        return image

    @property
    def free(self) -> int:
        """Degrees of freedom of Hotelling's T^2 as F."""
        return int(len(self.radiance) - self.turn.shape[1])

    def one(self, deviations: Floats) -> Floats:
        """Change (k, N) by one standard deviation of each component in one injection, enlarged."""
        return np.asarray(self.turn.T @ deviations / self.free**0.5)

    @property
    def of_mean(self) -> tuple[tuple[Part, ...], tuple[Floats, Floats]]:
        """Error of the mean of these injections: components, and the variance (H, W) of the rest,
        of T_app [K^2] and of the emissivity."""
        count = len(self.radiance)
        kelvin = self.kelvin(self.radiance, self.emissivity)
        deviations = kelvin, self.emissivity
        changes = (self.one(values) / count**0.5 for values in deviations)
        pairs = zip(*(self.image(values) for values in changes), strict=True)
        parts = tuple(
            Part(
                name=f"{INJECTIONS}, component {number}",
                kelvin=of_K,
                emissivity=of_e,
                degrees=float(self.free),
            )
            for number, (of_K, of_e) in enumerate(pairs, start=1)
        )
        rest_K2, rest_emissivity2 = (
            np.sum(values**2, axis=0) - np.sum((self.turn.T @ values) ** 2, axis=0)
            for values in deviations
        )
        squares = count * (count - 1)
        return parts, (
            self.image(np.maximum(rest_K2, 0.0) / squares),
            self.image(np.maximum(rest_emissivity2, 0.0) / squares),
        )

    def of_shots(self, shots: float) -> tuple[Part, ...]:
        """Errors of a recording whose `shots` at each background are other injections.

        The injections of one background move its point of the pixel's line, whose fit has the
        weights of the camera's noise and of the scatter between injections.
        """
        scene = self.run.scene
        boundary = Boundary.in_filter(
            Surroundings.from_scene(scene),
            self.curve.filter_um,
            reference_K=self.run.quadrature.reference_K,
        )
        x = boundary.leaving(scene.background.temperatures_K)[:, None]
        emissivity = self.maps.emissivity[self.seen].astype(float)
        radiance = emissivity * self.curve.radiance(
            self.maps.apparent_temperature_K[self.seen].astype(float)
        )
        sensor = SensorModel.from_scene(scene).exposed_for(float(boundary.seen(x).max()))
        camera = sensor.calibration()
        scale = camera.counts_per_radiance * boundary.front.transmission
        noise = sum(
            camera.variance_counts2(camera.counts(boundary.seen(light))) / scale**2
            for light in (x + 0.0 * radiance, (1.0 - emissivity) * x + radiance)
        )
        scatter = [
            np.sum((self.radiance - leaving * self.emissivity) ** 2, axis=0) for leaving in x
        ]
        weight = 1.0 / (noise + np.array(scatter) / (len(self.radiance) - 1))
        total, moment_1, moment_2 = (np.sum(weight * x**n, axis=0) for n in range(3))
        determinant = total * moment_2 - moment_1**2
        kelvin, of_e = [], []
        for k, at in enumerate(x[:, 0]):
            moved = (self.one(self.radiance) - at * self.one(self.emissivity)) / shots**0.5
            moved = moved * weight[k] / determinant
            slope, start = moved * (total * at - moment_1), moved * (moment_2 - moment_1 * at)
            kelvin.append(self.kelvin(start, -slope))
            of_e.append(-slope)
        parts = common_parts(
            self.maps, self.image(np.concatenate(kelvin)), self.image(np.concatenate(of_e))
        )
        return tuple(
            replace(
                part,
                name=part.name.replace(COMMON, "scatter of injections"),
                degrees=float(self.free),
            )
            for part in parts
        )


def _images(run: Run, seen: Mask, *, on_sensor: bool) -> tuple[Floats, Floats]:
    """Emissivity and own radiance (n, N) of the injections of a run, in the pixels `seen`."""
    assert run.ensemble is not None and run.folder is not None
    view, curve = SensorView.from_scene(run.scene), Curve(filter_um=run.quadrature.filter_um)
    emissivity, radiance = np.zeros((2, run.ensemble.members, np.count_nonzero(seen)))
    for number in range(len(radiance)):
        folder = member_folder(run.folder, number + 1) / "maps"
        seen_emissivity, kelvin = (
            read_image(folder / f"{name}.tif")[0].astype(float)
            for name in ("emissivity", "apparent_temperature_K")
        )
        finite = np.isfinite(kelvin)
        light = np.zeros(seen_emissivity.shape)
        light[finite] = seen_emissivity[finite] * curve.radiance(kelvin[finite])
        for into, image in ((emissivity, np.nan_to_num(seen_emissivity)), (radiance, light)):
            into[number] = (view.image(image) if on_sensor else image)[seen]
    return emissivity, radiance


def injections_p(
    baseline: Run | None, compared: Run | None, seen: Mask, *, of_emissivity: bool = False
) -> float | None:
    """Probability that the injections of two runs are of the same spray, by permutation.

    seen: (H, W) pixels that count. None if one has other pixels, or if there are too few injections
    for a p below the level of the test, which needs 5 on each side.
    """
    sides = []
    for run in (baseline, compared):
        if run is None or run.ensemble is None or run.folder is None:
            return None
        if run.maps.reason.shape != seen.shape:
            return None
        sides.append((run, *_images(run, seen, on_sensor=False)))
    count, of = len(sides[0][1]), sum(len(emissivity) for _, emissivity, _ in sides)
    if 2.0 / math.comb(of, count) > LEVEL:
        return None
    if of_emissivity:
        return permutation_p(sides[0][1], sides[1][1])
    curve = Curve(filter_um=sides[0][0].quadrature.filter_um)
    kelvin = np.mean([run.maps.apparent_temperature_K[seen] for run, *_ in sides], axis=0)
    black, slope = curve.radiance(kelvin), curve.slope(kelvin)
    images = [(radiance - black * emissivity) / slope for _, emissivity, radiance in sides]
    return permutation_p(images[0], images[1])


def permutation_p(baseline: Floats, compared: Floats) -> float:
    """Probability that two samples (n, N) and (m, N) of images differ as much by chance."""
    pooled = np.concatenate([baseline, compared])
    pooled = pooled - pooled.mean(axis=0)
    squares, turn = np.linalg.eigh(pooled @ pooled.T)
    count = min(_MOST, len(pooled) // 4)
    kept = [k for k in np.argsort(squares)[::-1][:count] if squares[k] > 1e-12 * squares.sum()]
    scores = turn[:, kept]  # of variance 1 / (n + m - 1) each
    if not kept:
        return 1.0

    def statistic(sides: Floats) -> Floats:
        """Squared sums (P,) of scores, of mean 0, over the members marked in (P, n + m)."""
        return np.asarray(np.sum((sides @ scores) ** 2, axis=1))

    marked = np.zeros((1, len(pooled)))
    marked[0, : len(baseline)] = 1.0
    true = float(statistic(marked)[0]) * (1.0 - 1e-9) - 1e-12
    if math.comb(len(pooled), len(baseline)) <= _EXACT:
        divisions = list(combinations(range(len(pooled)), len(baseline)))
        sides = np.zeros((len(divisions), len(pooled)))
        np.put_along_axis(sides, np.array(divisions), 1.0, axis=1)
        return float(np.mean(statistic(sides) >= true))
    rng = np.random.default_rng(1)
    sides = rng.permuted(np.repeat(marked, _EXACT, axis=0), axis=1)
    return float((1 + np.count_nonzero(statistic(sides) >= true)) / (1 + _EXACT))
