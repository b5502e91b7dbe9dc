"""Injections that differ: errors of the mean of a few, and of a recording of others.

The mean of n injections has the covariance S / n, with S that of one. An early injection moves all
tips, so that few images describe most of S: its largest principal components are errors that all
pixels share, and the rest counts as independent. S itself is estimated from the n injections. The
sum of squares of a difference along k such components is Hotelling's T^2, that is F with k and
n - k degrees of freedom after division by (n - 1) / (n - k), by which the components are enlarged.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.camera.view import SensorView
from cldit.comparison.chi_square import LEVEL
from cldit.comparison.permutation import permutation_p
from cldit.dit.budget import COMMON, Part, common_parts
from cldit.dit.maps import Maps
from cldit.io.images import read_image
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run import Run
from cldit.run.ensemble import INJECTIONS, member_folder

_MOST = 3  # components, and at most a third of the injections
_SMALL = 0.02  # share of the squares of a component that is left to the rest


@dataclass(frozen=True)
class OfInjections:
    """Error of a mean of injections (H, W): components, and the variance [K^2] of the rest."""

    parts: tuple[Part, ...]
    rest_K2: Floats


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
    own: Floats
    turn: Floats

    @classmethod
    def of(cls, run: Run, *, recorded: Maps | None = None) -> "Members | None":
        """Injections of a run, on the pixels of its sensor if `recorded`; None: fewer than 3."""
        if run.ensemble is None or run.folder is None or run.ensemble.members < 3:
            return None
        maps = run.maps if recorded is None else recorded
        seen = np.asarray(maps.has_temperature)
        emissivity, own = _images(run, seen, on_sensor=recorded is not None)
        return cls.about_mean(run, maps, seen, emissivity, own)

    @classmethod
    def about_mean(
        cls, run: Run, maps: Maps, seen: Mask, emissivity: Floats, own: Floats
    ) -> "Members":
        """Injections by their values (n, N) in the pixels `seen` of `maps`."""
        emissivity, own = emissivity - emissivity.mean(axis=0), own - own.mean(axis=0)
        found = cls(run, maps, seen, emissivity, own, np.zeros((len(own), 0)))
        weighed = maps.emissivity[seen] * found.kelvin(own, emissivity)
        squares, turn = np.linalg.eigh(weighed @ weighed.T)
        order = np.argsort(squares)[::-1][: min(_MOST, len(own) // 3)]
        kept = [k for k in order if squares[k] > _SMALL * squares.sum()]
        return replace(found, turn=turn[:, kept])

    @property
    def curve(self) -> Curve:
        """Radiance of a temperature."""
        return Curve(filter_um=self.run.quadrature.filter_um)

    def kelvin(self, own: Floats, emissivity: Floats) -> Floats:
        """Change of T_app, that of E / e, by those of E and e: dT = (dE - B(T) de) / (e dB/dT)."""
        light_K = self.maps.apparent_temperature_K[self.seen].astype(float)
        change = own - self.curve.radiance(light_K) * emissivity
        return np.asarray(change / (self.maps.emissivity[self.seen] * self.curve.slope(light_K)))

    def image(self, values: Floats) -> Floats:
        """Image (..., H, W) of values (..., N), 0 elsewhere."""
        found = np.zeros((*values.shape[:-1], *self.seen.shape))
        found[..., self.seen] = values
        return found

    @property
    def free(self) -> int:
        """Degrees of freedom of Hotelling's T^2 as F."""
        return int(len(self.own) - self.turn.shape[1])

    def one(self, deviations: Floats) -> Floats:
        """Change (k, N) by one standard deviation of each component in one injection, enlarged."""
        return np.asarray(self.turn.T @ deviations / self.free**0.5)

    @property
    def of_mean(self) -> OfInjections:
        """Error of the mean of these injections."""
        count = len(self.own)
        kelvin = self.kelvin(self.own, self.emissivity)
        rest = np.sum(kelvin**2, axis=0) - np.sum((self.turn.T @ kelvin) ** 2, axis=0)
        changes = (self.one(each) / count**0.5 for each in (kelvin, self.emissivity))
        parts = zip(*(self.image(each) for each in changes), strict=True)
        return OfInjections(
            tuple(
                Part(
                    name=f"{INJECTIONS}, component {number}",
                    kelvin=of_K,
                    emissivity=of_e,
                    degrees=float(self.free),
                )
                for number, (of_K, of_e) in enumerate(parts, start=1)
            ),
            self.image(np.maximum(rest, 0.0) / (count * (count - 1))),
        )

    def of_shots(self, shots: float) -> tuple[Part, ...]:
        """Errors of a recording whose `shots` at each background are other injections.

        The injections of one background move its point of the pixel's line, whose fit has the
        weights of the camera's noise and of the scatter between injections.
        """
        scene = self.run.scene
        around = Boundary.in_filter(
            Surroundings.from_scene(scene),
            self.curve.filter_um,
            reference_K=self.run.quadrature.reference_K,
        )
        x = around.leaving(scene.background.temperatures_K)[:, None]
        emissivity = self.maps.emissivity[self.seen].astype(float)
        own = emissivity * self.curve.radiance(
            self.maps.apparent_temperature_K[self.seen].astype(float)
        )
        sensor = SensorModel.from_scene(scene).exposed_for(float(around.seen(x).max()))
        camera = sensor.calibration()
        scale = camera.counts_per_radiance * around.front.transmission
        noise = sum(
            camera.variance_counts2(camera.counts(around.seen(light))) / scale**2
            for light in (x + 0.0 * own, (1.0 - emissivity) * x + own)
        )
        scatter = [np.sum((self.own - one * self.emissivity) ** 2, axis=0) for one in x]
        weight = 1.0 / (noise + np.array(scatter) / (len(self.own) - 1))
        total, first, second = (np.sum(weight * x**n, axis=0) for n in range(3))
        determinant = total * second - first**2
        kelvin, of_e = [], []
        for k, at in enumerate(x[:, 0]):
            moved = (self.one(self.own) - at * self.one(self.emissivity)) / shots**0.5
            moved = moved * weight[k] / determinant
            slope, start = moved * (total * at - first), moved * (second - first * at)
            kelvin.append(self.kelvin(start, -slope))
            of_e.append(-slope)
        parts = common_parts(
            self.maps, self.image(np.concatenate(kelvin)), self.image(np.concatenate(of_e))
        )
        return tuple(
            replace(
                one,
                name=one.name.replace(COMMON, "scatter of injections"),
                degrees=float(self.free),
            )
            for one in parts
        )


def _images(run: Run, seen: Mask, *, on_sensor: bool) -> tuple[Floats, Floats]:
    """Emissivity and own radiance (n, N) of the injections of a run, in the pixels `seen`."""
    assert run.ensemble is not None and run.folder is not None
    view, curve = SensorView.from_scene(run.scene), Curve(filter_um=run.quadrature.filter_um)
    emissivity, own = np.zeros((2, run.ensemble.members, np.count_nonzero(seen)))
    for number in range(len(own)):
        folder = member_folder(run.folder, number + 1) / "maps"
        here, kelvin = (
            read_image(folder / f"{name}.tif")[0].astype(float)
            for name in ("emissivity", "apparent_temperature_K")
        )
        known = np.isfinite(kelvin)
        light = np.zeros(here.shape)
        light[known] = here[known] * curve.radiance(kelvin[known])
        for into, image in ((emissivity, np.nan_to_num(here)), (own, light)):
            into[number] = (view.image(image) if on_sensor else image)[seen]
    return emissivity, own


def injections_p(one: Run | None, other: Run | None, seen: Mask) -> float | None:
    """Probability that the injections of two runs are of the same spray, by permutation.

    seen: (H, W) pixels that count. None if one has other pixels, or if there are too few injections
    for a p below the level of the test, which needs 5 on each side.
    """
    sides = []
    for run in (one, other):
        if run is None or run.ensemble is None or run.folder is None:
            return None
        if run.maps.reason.shape != seen.shape:
            return None
        sides.append((run, *_images(run, seen, on_sensor=False)))
    count, of = len(sides[0][1]), sum(len(emissivity) for _, emissivity, _ in sides)
    if 2.0 / math.comb(of, count) > LEVEL:
        return None
    curve = Curve(filter_um=sides[0][0].quadrature.filter_um)
    kelvin = np.mean([run.maps.apparent_temperature_K[seen] for run, *_ in sides], axis=0)
    black, slope = curve.radiance(kelvin), curve.slope(kelvin)
    images = [(own - black * emissivity) / slope for _, emissivity, own in sides]
    return permutation_p(images[0], images[1])
