"""Maps of every pixel from mean signals at each background."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Mask
from cldit.camera.curve import Curve
from cldit.dit.fit import (
    Pair,
    SharedError,
    apparent_radiance,
    emissivity,
    emissivity_gradient,
    fit_pair,
    radiance_gradient,
    shot_scatter,
)
from cldit.dit.maps import Maps, Reason
from cldit.optics.visible import VISIBLE_DISC, VISIBLE_EMISSIVITY

GAIN_ITERATIONS = 2  # the error falls by a factor of the relative drift, 0.1 at most, with each
DETECTION = 3.0  # least emissivity in standard errors ...
_ROUNDING = 16 * np.finfo(float).eps  # of the sums of a fit, over the largest signal
LEAST_EMISSIVITY = 1e-4  # ... and at all: the accuracy of a trace

KINDS = ("reference", "injection")
Cause = Literal["black body", "offset", "gain", "curvature", "amount"]


@dataclass(frozen=True, kw_only=True)
class Drift:
    """An error that references and injections of a background share, or all pixels of injections.

    It is a term of the fit. Parts of shape (1,) or (1, 1) are 0.

    cause: black body, camera's offset, gain or curvature, with the factors slope, 1, signal and
        signal^2, or the amount of spray, of injections alone.
    variance: (K,) of the mean at each background, independent; radiance^2, for the gain relative.
    modes: (M, K) of a steady drift, in the root of these units: each mode is one random number of
        variance 1 for all backgrounds and causes. excess: (M, K) by how much larger it is in
        the injections; None: equal. rate: (K,) of that drift per interval of the axis. course: (K,)
        of it in the references' means.
    scatter: (K,) variance of one exposure about that mean. jitter: (K,) the part of it that differs
        between successive exposures; the slow rest cancels if the kinds alternate.
    band: share of the filter in which the spray absorbs, of an amount.
    in_reference, in_injection: False if the black body was as read with this kind.
    """

    cause: Cause
    variance: Floats = field(default_factory=partial(np.zeros, 1))
    modes: Floats = field(default_factory=partial(np.zeros, (1, 1)))
    excess: Floats | None = None
    rate: Floats = field(default_factory=partial(np.zeros, 1))
    course: Floats = field(default_factory=partial(np.zeros, 1))
    scatter: Floats = field(default_factory=partial(np.zeros, 1))
    jitter: Floats = field(default_factory=partial(np.zeros, 1))
    band: float = 1.0
    in_reference: bool = True
    in_injection: bool = True

    def factors(self, lines: Pair, signals: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Factors, (N,) or (K, N), in references and in injections."""
        if self.cause == "black body":
            g, _, s, _ = np.nan_to_num(lines.values.T)
            return self.in_reference * g, self.in_injection * s
        if self.cause == "gain":
            return signals
        if self.cause == "curvature":
            return signals[0] ** 2, signals[1] ** 2
        if self.cause == "amount":
            change = _by_amount(lines, signals, band=self.band)
            return np.zeros_like(change), change
        return np.ones(signals[0].shape[1]), np.ones(signals[0].shape[1])


def by_amount(through: Floats, *, band: float) -> Floats:
    """Relative change of Delta I by that of the optical depth, at a transmission `through`.

    Delta I is proportional to 1 - r, with r the transmission in the share `band` of the filter in
    which the spray absorbs.
    """
    r = np.clip(1.0 - (1.0 - np.clip(through, 0.0, 1.0)) / band, 1e-6, 1.0 - 1e-6)
    return np.asarray(-np.log(r) * r / (1.0 - r))


def _by_amount(lines: Pair, signals: tuple[Floats, Floats], *, band: float) -> Floats:
    """Change (K, N) of the injections' signals by a relative change of the amount of spray."""
    g, _, s, _ = np.nan_to_num(lines.values.T)
    with np.errstate(over="ignore"):
        through = np.divide(s, g, out=np.ones_like(s), where=g > 0.0)
    return np.asarray(by_amount(through, band=band) * (signals[1] - signals[0]))


@dataclass(frozen=True, kw_only=True)
class Systematic:
    """Errors of the injections alone, and of single pixels.

    offset: radiance in every pixel, the same for all backgrounds. kelvin: likewise of the black
    body; slope, start: of the line of its radiance per kelvin over the radiance of the background.
    pixel_offset, pixel_gain: standard deviations from pixel to pixel between the kinds.
    extra: (K, ...) additional variances of the means by kind, or of a common `offset` or `gain` of
    single pixels.
    """

    offset: float = 0.0
    kelvin: float = 0.0
    slope: float = 0.0
    start: float = 0.0
    pixel_offset: float = 0.0
    pixel_gain: float = 0.0
    extra: Mapping[str, Floats] = field(default_factory=dict)

    def rows(self, rows: slice) -> "Systematic":
        """The errors in these rows of the image."""
        return replace(self, extra={name: images[:, rows] for name, images in self.extra.items()})

    def widened(self, lines: Pair) -> Pair:
        """The lines with that error, common to all backgrounds, in their covariance."""
        _, _, s, c_inj = lines.values.T
        covariance, shared = lines.covariance, lines.shared
        common = (self.kelvin * self.slope * s, self.offset + self.kelvin * self.start * s)
        for slope, start in (
            common,
            (0.0 * s, self.pixel_offset),
            (self.pixel_gain * s, self.pixel_gain * c_inj),
        ):
            change = _of_injections(lines, slope, start)
            covariance = covariance + change[:, :, None] * change[:, None, :]
        if self.offset or self.kelvin:  # of all pixels
            change = _of_injections(lines, *common)[None]
            shared = change if shared is None else np.concatenate([shared, change])
        return Pair(lines.values, covariance, lines.chi2, shared)


def _of_injections(lines: Pair, slope: Floats, start: Floats | float) -> Floats:
    """Change (N, 4) of the values of the lines by that of the injections' line."""
    change = np.zeros(lines.values.shape)
    change[:, 2], change[:, 3] = slope, start
    return change


@dataclass(frozen=True)
class Signals:
    """Signals of pixels (...) at K backgrounds, as radiance, photons s-1 m-2 sr-1.

    source: (K,) radiance that left the background disc.
    mean: (K, ...) mean over the exposures.
    camera: variance of one exposure due to the camera's noise, as a function of the signal.
    exposures: (K,) effective number.
    observed: (K, ...) sample variance of one exposure; 0 for a single one. spare: (K,) its degrees
        of freedom; None: one less than the exposures. common_removed: it is without what all pixels
        share.
    """

    source: Floats
    mean: Floats
    camera: Callable[[Floats], Floats]
    exposures: Floats
    observed: Floats | None = None
    spare: Floats | None = None
    common_removed: bool = False


def solve(
    reference: Signals,
    injection: Signals,
    *,
    usable: Mask,
    curve: Curve,
    drifts: Sequence[Drift] = (),
    systematic: Systematic | None = None,
    exact: bool = False,
) -> tuple[Maps, Floats]:
    """Maps of the pixels (...), and the errors that they have in common.

    These are changes (2, M, ...) of T_app [K] and emissivity by one standard deviation of each of M
    errors; the standard errors of the maps contain them.

    Standard errors include the camera's noise and, for injections, additional scatter between shots
    (`shot_scatter`, with two shots or more per background). References scatter by the camera's
    noise.

    The lines are fitted twice, the second time with the camera's noise at the fitted signals, since
    noise estimated from noisy counts would favour low ones. If the gain drifts they are fitted
    again at the signals without that drift.

    Args:
        reference, injection: means (K, ...) at each background, without and with spray.
        usable: (K, ...) False where a signal must not be used.
        drifts: errors that both kinds share; their part of single exposures is subtracted from the
            observed scatter, as alternating exposures share it.
        systematic: errors of the injections alone; None: none.
        exact: the means have no noise. It then does not hide a T_app, for instance that of a spray
            far hotter than the backgrounds.
    """
    shape = usable.shape[1:]
    usable = usable & np.isfinite(reference.mean) & np.isfinite(injection.mean)
    fit = _Fit(
        signals=(reference, injection),
        usable=usable.reshape(len(usable), -1),
        shape=shape,
        drifts=drifts,
        extra={} if systematic is None else systematic.extra,
    )
    lines = fit.start()
    iterations = 1 + (GAIN_ITERATIONS if np.any(fit.gain != 1.0) else 0)
    for number in range(1, iterations + 1):
        lines = fit.again(lines, with_shared=number == iterations)
    if systematic is not None:
        lines = systematic.widened(lines)
    maps = _maps(
        lines,
        backgrounds=fit.usable.sum(axis=0),
        curve=curve,
        shape=shape,
        least_visible=VISIBLE_EMISSIVITY if exact else np.inf,
        rounding=_ROUNDING * fit.largest_signal,
    )
    return maps, _common_errors(maps, lines, curve)


def _common_errors(maps: Maps, lines: Pair, curve: Curve) -> Floats:
    """Changes (2, M, ...) of T_app and of emissivity by each common error; NaN where the map is."""
    shape = maps.reason.shape
    if lines.shared is None:
        return np.zeros((2, 0, *shape))
    radiance = apparent_radiance(lines)[0]
    with np.errstate(invalid="ignore", over="ignore"):
        slope = curve.temperature_slope(np.where(maps.reason.ravel() == 0, radiance, np.nan))
        of_radiance = np.einsum("mni,ni->mn", lines.shared, radiance_gradient(lines))
        of_emissivity = np.einsum("mni,ni->mn", lines.shared, emissivity_gradient(lines))
    of_emissivity[:, np.isnan(maps.emissivity.ravel())] = np.nan  # it may be beyond any bound
    return np.stack([of_radiance * slope, of_emissivity]).reshape(2, -1, *shape)


_ByKind = tuple[Floats, Floats]
"""(K, N) of references and of injections."""


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Iterated fit of the lines of N pixels. signals: of references and injections, in images of
    `shape`. usable: (K, N). extra: as in `Systematic`."""

    signals: tuple[Signals, Signals]
    usable: Mask
    shape: tuple[int, ...]
    drifts: Sequence[Drift]
    extra: Mapping[str, Floats]

    def _flat(self, image: Floats) -> Floats:
        """(K, N) values, 0 where they are not usable."""
        return np.where(self.usable, image.reshape(self.usable.shape), 0.0)

    @cached_property
    def _mean(self) -> _ByKind:
        return self._flat(self.signals[0].mean), self._flat(self.signals[1].mean)

    @property
    def largest_signal(self) -> float:
        """Largest magnitude of all means."""
        return max(float(np.abs(kind).max(initial=0.0)) for kind in self._mean)

    @property
    def _source(self) -> _ByKind:
        return self.signals[0].source, self.signals[1].source

    @cached_property
    def gain(self) -> Floats:
        """(K, 1) gain of the camera by its steady drift, relative to that without."""
        gain = np.ones((len(self.usable), 1))
        for drift in self.drifts:
            if drift.cause == "gain":
                gain = gain + drift.course[:, None]
        return gain

    def start(self) -> Pair:
        """The fit with the camera's noise at the measured means."""
        noise = [kind.camera(mean) for kind, mean in zip(self.signals, self._mean, strict=True)]
        return fit_pair(
            self._source, self._mean, variance=self._variance(noise), usable=self.usable
        )

    def again(self, lines: Pair, *, with_shared: bool) -> Pair:
        """The fit with all errors at the signals of `lines`.

        A gain with the relative drift z multiplies the lines by 1 + a z, with a near 1. The means
        are therefore divided by 1 + z, and the change of the lines is added again: the result is
        linear in a about 1, and still allows a = 0.
        """
        reference, injection = lines.at(self._source)
        line = (np.nan_to_num(reference), np.nan_to_num(injection))
        factors: list[_ByKind] = []
        for drift in self.drifts:
            p, q = drift.factors(lines, line)
            factors.append((p / self.gain, q / self.gain))
        noise = [
            kind.camera(signal * self.gain) / self.gain**2
            for kind, signal in zip(self.signals, line, strict=True)
        ]
        scatter = self._scatter(_by_amount(lines, line, band=1.0), factors, camera=noise[1])
        return fit_pair(
            self._source,
            (
                self._mean[0] / self.gain + (1.0 - 1.0 / self.gain) * line[0],
                self._mean[1] / self.gain + (1.0 - 1.0 / self.gain) * line[1],
            ),
            variance=self._variance([noise[0] + scatter[0], noise[1] + scatter[1]]),
            usable=self.usable,
            errors=[*self._common(line, factors), *_steady(self.drifts, factors)],
            with_shared=with_shared,
        )

    def _variance(self, exposure: Sequence[Floats]) -> _ByKind:
        """Variance of the means, from that of one `exposure` of each kind."""
        reference, injection = (
            variance / signals.exposures[:, None]
            + (self._flat(self.extra[kind]) if kind in self.extra else 0.0)
            for kind, signals, variance in zip(KINDS, self.signals, exposure, strict=True)
        )
        return reference, injection

    def _scatter(
        self, change: Floats, factors: Sequence[_ByKind], *, camera: Floats
    ) -> list[Floats]:
        """Variance (K, N) of one exposure by kind, beyond the noise of the `camera`; `change` is
        that of the injections by a relative change of the amount."""
        injection, drifts = self.signals[1], self.drifts
        scatter = [np.zeros(self.usable.shape), np.zeros(self.usable.shape)]
        if injection.observed is not None and np.any(injection.exposures > 1):
            observed = self._flat(injection.observed) / self.gain**2
            for drift, (_, factor) in zip(drifts, factors, strict=True):
                # Its part of this pixel may differ from that of the mean.
                if not injection.common_removed:
                    observed = observed - drift.scatter[:, None] * factor**2
            spare = injection.exposures - 1.0 if injection.spare is None else injection.spare
            scatter[1] = shot_scatter(
                change,
                observed,
                camera=camera,
                degrees=np.where(self.usable, spare[:, None], 0.0),
                shape=self.shape,
            )
        for drift, by_kind in zip(drifts, factors, strict=True):
            for kind, factor in enumerate(by_kind):
                scatter[kind] = scatter[kind] + drift.jitter[:, None] * factor**2
        return scatter

    def _common(self, line: _ByKind, factors: Sequence[_ByKind]) -> list[SharedError]:
        """Errors that both kinds share, independent at each background."""
        ones = np.ones(self.usable.shape[1])
        return [
            SharedError(variance=drift.variance, reference=p, injection=q)
            for drift, (p, q) in zip(self.drifts, factors, strict=True)
        ] + [
            SharedError(variance=self._flat(self.extra[name]), reference=p, injection=q)
            for name, (p, q) in (("offset", (ones, ones)), ("gain", line))
            if name in self.extra
        ]


def _steady(drifts: Sequence[Drift], factors: Sequence[_ByKind]) -> list[SharedError]:
    """Steady drifts: an error for each mode, with the parts of all causes."""
    errors: list[SharedError] = []
    for mode in range(max((len(d.modes) for d in drifts if d.modes.any()), default=0)):
        reference, injection = [], []
        for drift, (p, q) in zip(drifts, factors, strict=True):
            if drift.modes.any() and mode < len(drift.modes):
                course = drift.modes[mode]
                excess = 0.0 if drift.excess is None else drift.excess[mode]
                reference.append(course[:, None] * p)
                injection.append((course + excess)[:, None] * q)
        errors.append(
            SharedError(reference=np.sum(reference, axis=0), injection=np.sum(injection, axis=0))
        )
    return errors


def _maps(
    lines: Pair,
    *,
    backgrounds: NDArray[np.int_],
    curve: Curve,
    shape: tuple[int, ...],
    least_visible: float,
    rounding: float,
) -> Maps:
    """Maps of the fitted lines; an emissivity above `least_visible` is seen whatever its error.

    rounding: of the lines' intercepts, which hides the light of a far colder spray.
    """
    epsilon, epsilon_variance = emissivity(lines)
    radiance, radiance_variance = apparent_radiance(lines)
    epsilon_error = np.sqrt(epsilon_variance)
    reason = np.zeros(backgrounds.shape, np.uint8)
    # The last assignment wins; comparisons with NaN are False, hence the negations.
    spray_light = lines.values[:, 3] - lines.values[:, 1]  # light of the spray itself
    reason[~((radiance > 0.0) & (spray_light > rounding))] = Reason.NEGATIVE_RADIANCE
    clear = np.clip(DETECTION * epsilon_error, LEAST_EMISSIVITY, least_visible)
    reason[~(epsilon > clear)] = Reason.EMISSIVITY_TOO_LOW
    reason[~(lines.values[:, 0] >= VISIBLE_DISC)] = Reason.BACKGROUND_NOT_VISIBLE
    reason[backgrounds < 2] = Reason.TOO_FEW_BACKGROUNDS
    seen = (reason == Reason.OK) | (reason >= Reason.EMISSIVITY_TOO_LOW)
    warm = np.where(reason == Reason.OK, radiance, np.nan)
    temperature = curve.temperature(warm)
    with np.errstate(invalid="ignore"):  # 0 K: infinite slope, times an error that may be 0
        temperature_error = np.sqrt(radiance_variance) * curve.temperature_slope(warm)
    degrees = 2 * backgrounds - 4
    spare = seen & (degrees > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        reduced = np.where(spare, lines.chi2 / degrees, np.nan)
        chance = np.where(spare, scipy.special.chdtrc(np.maximum(degrees, 1), lines.chi2), np.nan)

    covariance = lines.between(emissivity_gradient(lines), radiance_gradient(lines))
    with np.errstate(divide="ignore", invalid="ignore"):  # 0 / 0 without noise
        correlation = covariance / np.sqrt(epsilon_variance * radiance_variance)

    def image(value: Floats) -> NDArray[np.float32]:
        with np.errstate(over="ignore"):  # an error beyond single precision is infinite
            return value.astype(np.float32).reshape(shape)

    return Maps(
        emissivity=image(np.where(seen, epsilon, np.nan)),
        apparent_temperature_K=image(temperature),
        emissivity_standard_error=image(np.where(seen, epsilon_error, np.nan)),
        apparent_temperature_standard_error_K=image(temperature_error),
        reason=reason.reshape(shape),
        reduced_chi2=image(reduced),
        fit_probability=image(chance),
        error_correlation=image(np.where(reason == Reason.OK, correlation, np.nan)),
    )
