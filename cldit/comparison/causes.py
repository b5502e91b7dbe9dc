"""Errors that all pixels share, and quantities that would explain a difference.

With the covariance C of a difference r (`chi_square.py`), a change by s k of known image k lowers
chi-square most at

    s = k' C^-1 r / k' C^-1 k        by s^2 k' C^-1 k        with the error (k' C^-1 k)^-1/2.

The same holds for a mode, which is in C with the variance 1: s is its size if it were free, of
which k' C^-1 k / (1 - k' C^-1 k) is the inverse of the variance.
Temperatures of walls and patches change T_app as the stored weights of their light say, those of
the black body by its radiance. Both are evaluated again at the size found, which is no derivative.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.curve import Curve
from cldit.comparison.chi_square import ChiSquare
from cldit.comparison.shown import Shown
from cldit.comparison.tested import Tested
from cldit.dit.evaluate import evaluated, sensor_of
from cldit.optics.response import Filter, scene_filter

_LARGEST = 5.0  # stated deviations of an error that explains anything
_FARTHEST_K = 150.0  # of a temperature
_STEP_K = 5.0  # of the first estimate
_LEAST_K = 1e-3
_MOST_OFTEN, _ENOUGH = 12, 2e-3  # evaluations of a temperature, until it changes by less
_MOSTLY = 0.5  # of what the errors leave, by a cause that is named
_CLEAR = 9.0  # of chi-square: the size of a cause is 3 of its errors or more
_BY_CHANCE = 3.84  # of chi-square: causes that explain as much with a probability of 5 %


# Name of a temperature, and change (H, W) of the difference if it is so many kelvin higher in the
# second result.
Trial = tuple[str, Callable[[float], Floats]]


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A quantity that explains a difference.

    size, error: in `unit`, kelvin or stated deviations. share: of the chi-square beyond that of the
    errors. p_value: of the rest of the difference.
    """

    name: str
    size: float
    error: float
    unit: str
    share: float
    p_value: float

    @property
    def text(self) -> str:
        """`walls, +20 ± 1 K`."""
        digits = max(0, 1 - math.floor(math.log10(self.error))) if self.error > 0.0 else 1
        digits = min(digits, 1 if abs(self.size) >= 1.0 else 2)
        return f"{self.name}, {self.size:+.{digits}f} ± {self.error:.{digits}f} {self.unit}"


def trials(
    baseline: Shown, compared: Shown, seen: tuple[Shown, Shown], onto: Callable[[Shown], Floats]
) -> Iterator[Trial]:
    """Temperatures of the walls and patches of a trace, and of the black body of a recording.

    seen: both on the same pixels. onto: T_app (H, W) of the trace, evaluated otherwise, on these.
    """
    trace = next((shown for shown in (compared, baseline) if shown.run is not None), None)
    if trace is not None and trace.run is not None:
        names = {"walls": "walls.temperature_K"}
        for number, patch in enumerate(trace.run.scene.patches):
            names[f"patch {patch.name}"] = f"patches[{number}].temperature_K"
        unchanged_K = onto(_evaluated(trace, {}))
        sign = 1.0 if trace is compared else -1.0
        for name, key in names.items():

            def change(kelvin: float, key: str = key) -> Floats:
                return sign * (unchanged_K - onto(_evaluated(trace, {key: -sign * kelvin})))

            yield name, change
    stated = any("black body" in part.name for shown in seen for part in shown.systematic)
    for shown, sign in zip(seen, (-1.0, 1.0), strict=True):
        scene = shown.scene or (shown.traced and shown.traced.scene)
        if shown.noisy and scene and not stated:
            yield "background", _background(shown, scene_filter(scene), sign)
            return


def _evaluated(shown: Shown, kelvin: dict[str, float]) -> Shown:
    """A trace evaluated with other temperatures, by keys and their changes."""
    run = shown.run
    assert run is not None
    scene = run.scene
    values = {"walls.temperature_K": scene.walls.temperature_K}
    values |= {f"patches[{n}].temperature_K": p.temperature_K for n, p in enumerate(scene.patches)}
    scene = scene.with_(**{key: values[key] + change for key, change in kelvin.items()})
    sensor = sensor_of(scene, run.quadrature, (run.spectral, run.reference))
    maps = evaluated(scene, run.quadrature, run.spectral, run.reference, sensor)
    return replace(shown, maps=maps, run=replace(run, scene=scene, maps=maps))


def _background(shown: Shown, filter_um: Filter, sign: float) -> Callable[[float], Floats]:
    """Change of T_app by a black body that is warmer than it was taken to be.

    Shots with and without spray are as bright where e I(T_app) = e x, with x the radiance that is
    taken to leave the black body: I(T_app) falls as x rises above it.
    """
    curve = Curve(filter_um=filter_um)
    assert shown.traced is not None
    at_K = float(np.median(shown.traced.scene.background.temperatures_K))
    kelvin = shown.maps.apparent_temperature_K.astype(float)
    light = curve.radiance(np.where(np.isfinite(kelvin), kelvin, at_K))

    def change(by_K: float) -> Floats:
        rise = curve.radiance(at_K + sign * by_K) - curve.radiance(at_K)
        with np.errstate(invalid="ignore"):
            return np.asarray(sign * (kelvin - curve.temperature(light + rise)))

    return change


def causes(change: Floats, tested: Tested, tried: Iterable[Trial]) -> tuple[Cause, ...]:
    """The cause that explains most of a difference, and those that explain as much within chance.

    None explains less than half of what the errors leave, or is a stated error of more than 5
    deviations.
    """
    nominal = tested.again(change)
    if nominal is None:
        return ()
    fit = _Fit.of(change, tested, nominal)
    candidates = []
    for name, change_by in tried:
        kelvin, before_K = change_by(_STEP_K) / _STEP_K, math.inf
        for _ in range(_MOST_OFTEN):
            size, weight = fit.size_of(kelvin)
            size = float(np.clip(size, -_FARTHEST_K, _FARTHEST_K))
            if abs(size - before_K) < _ENOUGH * abs(size) or abs(size) < _LEAST_K:
                break
            kelvin, before_K = change_by(size) / size, size
        error = max(weight, 1e-12) ** -0.5
        candidates.append((size**2 * weight, name, "K", kelvin, size, error))
    for mode in tested.modes:
        image = mode.of(tested.observable)
        size, weight = fit.size_of(image)
        if abs(size) <= _LARGEST:
            gain, error = size**2 * weight, (max(1.0 - weight, 0.0) / max(weight, 1e-12)) ** 0.5
            candidates.append((gain, mode.name, "stated deviations", image, size, error))
    candidates.sort(key=lambda candidate: -candidate[0])
    beyond, best = fit.beyond, max((candidate[0] for candidate in candidates), default=0.0)
    if best < max(_MOSTLY * beyond, _CLEAR):
        return ()
    out = []
    for gain, name, unit, image, size, error in candidates:
        if gain >= max(best - _BY_CHANCE, _CLEAR):
            rest = tested.again(change - size * np.nan_to_num(image))
            out.append(
                Cause(
                    name=name,
                    size=size,
                    error=error,
                    unit=unit,
                    share=min(gain / beyond, 1.0),
                    p_value=0.0 if rest is None else rest.p_value,
                )
            )
    return tuple(out)


@dataclass(frozen=True)
class _Fit:
    """Fit of single images to a difference with its errors.

    where: (H, W) the N pixels that count. noise: (N,) independent errors. z: (N,) the difference in
    these. modes: (M, N) likewise. even: factor of the variance of a mean by neighbours.
    """

    where: Mask
    noise: Floats
    z: Floats
    modes: Floats
    even: float

    @classmethod
    def of(cls, change: Floats, tested: Tested, nominal: ChiSquare) -> _Fit:
        """The fit to a `change` (H, W), whose chi-square is `nominal`."""
        where = np.isfinite(nominal.residuals)
        noise, z = tested.independent[where], change[where] / tested.independent[where]
        images = [mode.of(tested.observable)[where] for mode in tested.modes]
        modes = np.array(images).reshape(len(images), z.size) / noise
        return cls(where, noise, z, modes, nominal.correlated)

    @cached_property
    def _solved(self) -> Floats:
        """Modes (M, N) by the inverse of their products, for all images."""
        b = self.modes
        return np.asarray(np.linalg.solve(self.even * np.eye(len(b)) + b @ b.T, b))

    def _less_modes(self, values: Floats) -> Floats:
        """Values (N,) less the modes that fit them best: C^-1 k in units of the noise."""
        return np.asarray(values - (self.modes @ values) @ self._solved)

    def size_of(self, image: Floats) -> tuple[float, float]:
        """Best size of an image (H, W), and its weight k' C^-1 k."""
        k = np.nan_to_num(image[self.where]) / self.noise
        weighed = self._less_modes(k)
        weight = float(k @ weighed)
        return (float(self.z @ weighed) / weight if weight > 0.0 else 0.0), weight / self.even

    @property
    def beyond(self) -> float:
        """Chi-square beyond that of the errors."""
        square = float(self.z @ self._less_modes(self.z))
        return max(square - len(self.z), 1.0) / self.even
