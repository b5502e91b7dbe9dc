"""From mean signals before each background to the maps, pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from cldit.camera.curve import Curve
from cldit.dit.fit import CommonError, Pair, apparent_radiance, emissivity, fit_pair, shot_scatter
from cldit.dit.maps import Maps, Reason

Floats = NDArray[np.float64]

VISIBLE = 0.5  # share of the disc's radiance that a pixel must see without spray
_THIN = 0.05  # emissivity below which its own radiance is not looked for
DETECTION = 3.0  # an emissivity of fewer standard errors is not told from zero ...
LEAST_EMISSIVITY = 1e-4  # ... nor is one below the accuracy of a trace


Cause = Literal["black body", "offset", "gain"]


@dataclass(frozen=True, kw_only=True)
class Drift:
    """An error that both kinds share before one background, and by what it reaches the means.

    cause: black body, by the lines' slopes; offset of the camera, by 1; its gain, by the signals.
    variance: (K,) of the mean before each background: radiance^2, for the gain relative.
    each: (K,) of one exposure about that mean. jitter: (K,) of it, what differs from one exposure
        to the next; the rest is slow, and drops out of kinds that alternate.
    """

    cause: Cause
    variance: Floats
    each: Floats
    jitter: Floats

    def factors(self, lines: Pair, signals: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """(N,) or (K, N) for references and for injections, of fitted `lines` and `signals`."""
        if self.cause == "black body":
            g, _, s, _ = np.nan_to_num(lines.values.T)
            return g, s
        if self.cause == "gain":
            return signals
        return np.ones(signals[0].shape[1]), np.ones(signals[0].shape[1])


@dataclass(frozen=True, kw_only=True)
class Absorbed:
    """What the lines of both kinds take of a steady drift for their own.

    offset: slope and start of the line through the drift of the offset, over the radiance of the
    background. gain: slope of that through the relative drift of the gain.
    """

    offset: tuple[float, float] = (0.0, 0.0)
    gain: float = 0.0

    def moved(self, lines: Pair) -> tuple[Floats, Floats]:
        """(N, 4) change of both lines by the offset, and by the gain.

        A gain that rises with the background makes the spray's own radiance, e I(T_app), part of
        the slope: the emissivity loses gain e I(T_app). The same change of both slopes says so, and
        leaves T_app to the variance of the gain.
        """
        g, c_ref, s, c_inj = lines.values.T
        offset = np.broadcast_to(np.array([*self.offset, *self.offset]), lines.values.shape)
        share = np.maximum(1.0 - s / g, _THIN)
        tilt = self.gain * (c_inj - c_ref) / share
        nothing = np.zeros_like(tilt)
        return np.asarray(offset), np.stack([tilt, nothing, tilt, nothing], axis=1)


@dataclass(frozen=True, kw_only=True)
class Systematic:
    """Errors that are the same before all backgrounds, or of one picture.

    The first four: how far injections may stand off references for another reason than the spray.

    offset: radiance, in every pixel. kelvin: of the black body. slope, start: of the line through
    its radiance per kelvin, over the radiance of the background. absorbed: drift that both kinds
    share. extra: (K, ...) variance of the injections' means of each pixel.
    """

    offset: float = 0.0
    kelvin: float = 0.0
    slope: float = 0.0
    start: float = 0.0
    absorbed: Absorbed = Absorbed()
    extra: Floats | None = None

    def rows(self, rows: slice) -> Systematic:
        """The part of a picture in these rows."""
        return self if self.extra is None else replace(self, extra=self.extra[:, rows])

    def widened(self, lines: Pair) -> Pair:
        """The lines with that error in their covariance, the same before all backgrounds."""
        if not (self.offset or self.kelvin or self.absorbed != Absorbed()):
            return lines
        s = lines.values[:, 2]
        apart = np.zeros_like(lines.values)
        apart[:, 2] = self.kelvin * self.slope * s
        apart[:, 3] = self.offset + self.kelvin * self.start * s
        with np.errstate(divide="ignore", invalid="ignore"):
            both = self.absorbed.moved(lines)
        covariance = lines.covariance + sum(
            moved[:, :, None] * moved[:, None, :] for moved in (apart, *both)
        )
        return Pair(lines.values, covariance, lines.chi2)


@dataclass(frozen=True)
class Signals:
    """What pixels (...) saw before K backgrounds, as radiance, photons s-1 m-2 sr-1.

    source: (K,) radiance that left the background disc.
    mean: (K, ...) mean over the exposures.
    camera: variance of one exposure by the camera's noise, of any signals.
    exposures: (K,) how many; less where some count less than others.
    observed: (K, ...) sample variance of one exposure; 0 where there is only one.
    """

    source: Floats
    mean: Floats
    camera: Callable[[Floats], Floats]
    exposures: Floats
    observed: Floats | None = None


def solve(
    reference: Signals,
    injection: Signals,
    *,
    usable: NDArray[np.bool_],
    curve: Curve,
    drifts: Sequence[Drift] = (),
    systematic: Systematic | None = None,
) -> Maps:
    """Maps of the pixels (...).

    Standard errors come from the camera's noise and, for the injections, from the scatter observed
    between shots beyond it (`shot_scatter`; needs two shots before a background, and is then never
    below the camera's own noise). References are taken to scatter by the camera's noise alone.

    The lines are fitted twice: the second time with the camera's noise at the fitted signals, since
    noise taken from noisy counts would favour those that came out low.

    Args:
        reference, injection: means (K, ...) before each background, without and with spray.
        usable: (K, ...) False where a pixel's signal before that background must not be used.
        curve: black-body temperature to radiance.
        drifts: errors that both kinds share. What they do to single exposures is taken off the
            observed scatter: exposures that alternate see it alike.
        systematic: how far injections may stand off references; None: not at all.
    """
    shape = usable.shape[1:]
    usable = usable & np.isfinite(reference.mean) & np.isfinite(injection.mean)
    usable = usable.reshape(len(usable), -1)

    def flat(image: Floats) -> Floats:
        return np.where(usable, image.reshape(usable.shape), 0.0)

    source = (reference.source, injection.source)
    mean = (flat(reference.mean), flat(injection.mean))
    exposures = (reference.exposures[:, None], injection.exposures[:, None])
    still = np.zeros_like(mean[0])
    more = still
    if systematic is not None and systematic.extra is not None:
        more = flat(systematic.extra)

    def fit(
        signals: tuple[Floats, Floats],
        extra: tuple[Floats, Floats],
        common: Sequence[CommonError],
    ) -> Pair:
        calm = reference.camera(signals[0]) + extra[0]
        varied = injection.camera(signals[1]) + extra[1]
        return fit_pair(
            source,
            mean,
            variance=(calm / exposures[0], varied / exposures[1] + more),
            usable=usable,
            common=common,
        )

    lines = fit(mean, (still, still), ())
    before, during = (np.nan_to_num(one) for one in lines.at(source))
    factors = [drift.factors(lines, (before, during)) for drift in drifts]
    extra = still
    if injection.observed is not None and np.any(injection.exposures > 1):
        observed = flat(injection.observed)
        for drift, (_, factor) in zip(drifts, factors, strict=True):
            observed = observed - drift.each[:, None] * factor**2
        extra = shot_scatter(
            during - before,
            observed,
            camera=injection.camera(during),
            degrees=np.where(usable, exposures[1] - 1.0, 0.0),
        )
    common = [
        CommonError(variance=drift.variance, reference=p, injection=q)
        for drift, (p, q) in zip(drifts, factors, strict=True)
    ]
    jitter = [still, extra]
    for drift, both in zip(drifts, factors, strict=True):
        for kind, factor in enumerate(both):
            jitter[kind] = jitter[kind] + drift.jitter[:, None] * factor**2
    lines = fit((before, during), (jitter[0], jitter[1]), common)
    if systematic is not None:
        lines = systematic.widened(lines)
    return _maps(lines, backgrounds=usable.sum(axis=0), curve=curve, shape=shape)


def _maps(
    lines: Pair, *, backgrounds: NDArray[np.int_], curve: Curve, shape: tuple[int, ...]
) -> Maps:
    epsilon, epsilon_variance = emissivity(lines)
    radiance, radiance_variance = apparent_radiance(lines)
    epsilon_error = np.sqrt(epsilon_variance)
    reason = np.zeros(backgrounds.shape, np.uint8)
    # The first that holds is the reason; comparisons with NaN are False, hence the negations.
    reason[~(radiance >= 0.0)] = Reason.NEGATIVE_RADIANCE
    clear = np.maximum(DETECTION * epsilon_error, LEAST_EMISSIVITY)
    reason[~(epsilon > clear)] = Reason.EMISSIVITY_TOO_LOW
    reason[~(lines.values[:, 0] >= VISIBLE)] = Reason.BACKGROUND_NOT_VISIBLE
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
        chance = np.where(spare, chdtrc(np.maximum(degrees, 1), lines.chi2), np.nan)

    def image(value: Floats) -> NDArray[np.float32]:
        return value.astype(np.float32).reshape(shape)

    return Maps(
        emissivity=image(np.where(seen, epsilon, np.nan)),
        apparent_temperature_K=image(temperature),
        emissivity_standard_error=image(np.where(seen, epsilon_error, np.nan)),
        apparent_temperature_standard_error_K=image(temperature_error),
        reason=reason.reshape(shape),
        reduced_chi2=image(reduced),
        fit_probability=image(chance),
    )
