"""Injections that tell two models of a spray apart, or that none would.

The difference d (N,) of T_app between two models is compared with its covariance

    C = D / n + S S' / n + U U' + u u'

with D the noise of the camera of one injection and one reference per background, S the common part
of the scatter of the optical depth, and U the errors of the setup (`cldit.dit.budget`), whose
images are known. Of the errors of both simulations, and of the differences between injections that
`spray.scatter` describes, the size s is known in every pixel but hardly their image. They are taken
to be one error u for all pixels, with the least favourable image: u = d t within -s to s, for the
factor t with which the models look most alike. Errors that the simulations share belong to s as
well: they leave d as it is, and make either model look like the other. The likelihood ratio of the
models then has the distance

    z = (d' C^-1 d)^1/2

in standard deviations, and a test at the level of 1 % finds the difference in 95 % of all
measurements if z is at least 3.97.
"""

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from cldit.arrays import Floats
from cldit.dit.budget import budget
from cldit.dit.design import MOST_SHOTS, BlackBody, temperatures_K
from cldit.dit.maps import Maps, Reason
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.optics.spectral import Quadrature
from cldit.radiance.boundary import Surroundings
from cldit.radiance.weights import Weights
from cldit.scene.schema import Scene

LEVEL, POWER = 0.01, 0.95
NEEDED = float(ndtri(1.0 - LEVEL) + ndtri(POWER))
_LEVELS = 5  # of the lowest and of the highest background that are tried
_FACTORS = np.geomspace(1e-4, 1e4, 25)  # t
_BETWEEN = np.geomspace(0.47, 2.15, 17)  # to the next of these: z to 5 %


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The fastest plan at one delay that separates two models, or the nearest to it.

    shots: injections, and references, per background; None: no number of them does. distance: z of
    the plan, or of the most shots. of_noise: z for the same shots if setup and simulations had no
    error. time_s: None if none is enough; includes the waiting for the black body. rms_K: of the
    difference. largest: error that all shots share without which z would rise most.
    """

    delay_s: float | None
    backgrounds_K: tuple[float, ...]
    shots: int | None
    distance: float
    of_noise: float
    time_s: float | None
    rms_K: float
    largest: str = ""

    @property
    def order(self) -> tuple[float, float]:
        """Sorts the fastest plan to the front, or the one that comes nearest."""
        return (math.inf if self.time_s is None else self.time_s, -self.distance)

    @property
    def text(self) -> str:
        """Conclusion on one line."""
        if self.shots is not None:
            return (
                f"{self.shots} injections and references at each of {len(self.backgrounds_K)} "
                f"backgrounds tell them apart: {self.distance:.1f} standard deviations"
            )
        if self.rms_K == 0.0:
            return "cannot be told: both models have the same T_app"
        limit = f"; most of the error: {self.largest}" if self.largest else ""
        return (
            f"cannot be told: {MOST_SHOTS} injections leave {self.distance:.1f} standard "
            f"deviations, and {NEEDED:.2g} are needed{limit}"
        )


@dataclass(frozen=True, kw_only=True)
class Rivals:
    """Two models in one view at one delay.

    model, rival: signals of the sensor's pixels. injections: spectral weights of single injections
    of the model, in these pixels. errors_K: (N,) error of the simulations by source.
    """

    scene: Scene
    model: Subject
    rival: Subject
    injections: Sequence[Subject]
    errors_K: Mapping[str, Floats]
    delay_s: float | None = None

    def best(
        self, blackbody: BlackBody, *, shot_s: float, counts: Sequence[int] = (2, 3, 5, 7)
    ) -> Separation:
        """The fastest of all sets of backgrounds within the limits."""
        low_K, high_K = blackbody.limits_K
        levels = np.linspace(low_K, high_K, _LEVELS)
        tried = [
            backgrounds
            for count in counts
            for low in levels
            for high in levels[levels > low]
            if len(set(backgrounds := temperatures_K(low, high, count))) > 1
        ]
        if not tried:
            raise EvaluationError(
                f"backgrounds: {low_K:g} K alone; two models are separated with two or more"
            )
        plans = [self.at(backgrounds, blackbody, shot_s=shot_s) for backgrounds in tried]
        best = min(plans, key=lambda plan: plan.order)
        test, shots = self._test(best.backgrounds_K), best.shots or MOST_SHOTS
        z = {name: test.without(name).distance(shots) for name in (*test.setup, *test.models)}
        return replace(best, largest=max(z, key=lambda name: z[name], default=""))

    def distance(self, backgrounds_K: tuple[float, ...], shots: int) -> float:
        """z with so many injections, and references, at each background."""
        return self._test(backgrounds_K).distance(shots)

    def rms_K(self, backgrounds_K: tuple[float, ...]) -> float:
        """RMS of the difference of T_app."""
        return self._test(backgrounds_K).rms_K

    def at(
        self, backgrounds_K: tuple[float, ...], blackbody: BlackBody, *, shot_s: float
    ) -> Separation:
        """The fewest shots that tell the models apart with these backgrounds."""
        test = self._test(backgrounds_K)
        shots: int | None = None
        if test.distance(MOST_SHOTS) >= NEEDED:
            shots = bisect_left(range(MOST_SHOTS), NEEDED, lo=1, key=test.distance)
        taken = MOST_SHOTS if shots is None else shots
        waiting_s = blackbody.time_s(backgrounds_K)
        return Separation(
            delay_s=self.delay_s,
            backgrounds_K=backgrounds_K,
            shots=shots,
            distance=test.distance(taken),
            of_noise=replace(test, setup={}, models={}).distance(taken),
            time_s=shots and waiting_s + 2 * shots * len(backgrounds_K) * shot_s,
            rms_K=test.rms_K,
        )

    def _test(self, backgrounds_K: tuple[float, ...]) -> "_Test":
        calm = replace(self.model, scatter=0.0)
        at_K = calm.temperature_K(backgrounds_K)
        change_K = replace(self.rival, scatter=0.0).temperature_K(backgrounds_K) - at_K
        finite = np.isfinite(change_K)
        if not finite.any():
            raise EvaluationError("no pixel has a T_app with both models")
        noise_K2 = calm.variances(backgrounds_K)[0].sum(axis=0)
        bare, spray = calm.both(backgrounds_K)
        slopes = np.nan_to_num(calm.response(backgrounds_K))
        depth = slopes * calm.depth_response(bare, spray) * self.model.scatter / math.sqrt(2.0)
        # The simulated rig's field: a common part, and a smooth one with the correlation
        # exp(-(r / L)^2), whose integral over the image is pi L^2.
        length_m = self.scene.spray.scatter.length_m
        pixel_m2 = float(np.prod(self.scene.camera.field_m)) / self.scene.camera.sensor.pixels[0]
        pixel_m2 /= self.scene.camera.sensor.pixels[1]
        noise_K2 = noise_K2 + (depth**2).sum(axis=0) * max(1.0, math.pi * length_m**2 / pixel_m2)
        varied_K2 = np.zeros_like(noise_K2)
        if len(self.injections) > 1:
            seen = np.array([injection.both(backgrounds_K)[1] for injection in self.injections])
            varied_K2 = np.sum(slopes**2 * seen.var(axis=0, ddof=1), axis=0)
        share = self.model.pixels / len(finite)
        return _Test(
            change_K=change_K[finite],
            noise_K2=noise_K2[finite] / share,
            depth=depth[:, finite],
            varied_K2=varied_K2[finite],
            setup={
                name: np.nan_to_num(change[finite])
                for name, change in self._of_setup(at_K, backgrounds_K).items()
            },
            models={name: kelvin[finite] for name, kelvin in self.errors_K.items()},
        )

    def _of_setup(self, at_K: Floats, backgrounds_K: tuple[float, ...]) -> dict[str, Floats]:
        """Change of T_app (N,) by each systematic error of a measurement."""
        bare, spray = (signals[[0, -1]] for signals in self.model.both(backgrounds_K))
        emissivity = 1.0 - (spray[1] - spray[0]) / (bare[1] - bare[0])
        maps = Maps.unevaluated((1, at_K.size), Reason.OK)
        maps = replace(
            maps,
            apparent_temperature_K=at_K[None].astype(np.float32),
            emissivity=emissivity[None].astype(np.float32),
        )
        errors = budget(
            maps,
            Surroundings.from_scene(self.scene),
            curve=self.model.curve,
            backgrounds_K=backgrounds_K,
            calibration=self.model.exposure(max(backgrounds_K)).calibration(),
        )
        return {part.name: part.kelvin[0] for part in errors.parts}


@dataclass(frozen=True, kw_only=True)
class _Test:
    """d and the parts of C: `depth` is S, `setup` U by name; `varied_K2` and `models` make s."""

    change_K: Floats
    noise_K2: Floats
    depth: Floats
    varied_K2: Floats
    setup: Mapping[str, Floats]
    models: Mapping[str, Floats]

    @property
    def rms_K(self) -> float:
        return float(np.sqrt(np.mean(self.change_K**2)))

    def without(self, name: str) -> "_Test":
        """The same without one error of setup or simulations."""
        setup, models = (
            {key: change for key, change in of.items() if key != name}
            for of in (self.setup, self.models)
        )
        return replace(self, setup=setup, models=models)

    def distance(self, shots: int) -> float:
        """z with so many injections and references per background."""
        noise = np.sqrt(self.noise_K2 / shots)
        size = np.sqrt(self.varied_K2 / shots + sum(error_K**2 for error_K in self.models.values()))
        z = self.change_K / noise
        b = np.array([*self.depth / math.sqrt(shots), *self.setup.values()]) / noise
        inner = np.eye(len(b)) + b @ b.T

        def squares(factors: Floats) -> Floats:
            """z^2 with the image of each factor.

            It is a sum of squares of what the errors of known image leave, and of their sizes; as a
            difference it would lose all digits.
            """
            stacked = np.vstack([z, np.clip(factors[:, None] * self.change_K, -size, size) / noise])
            sizes = np.linalg.solve(inner, b @ stacked.T)
            rest = np.hstack([stacked - sizes.T @ b, sizes.T])
            images = rest[1:]
            best = (images @ rest[0]) / (1.0 + np.sum(images**2, axis=1))
            return np.asarray(np.sum((rest[0] - best[:, None] * images) ** 2, axis=1) + best**2)

        nearest = _FACTORS[np.argmin(squares(_FACTORS))]
        return math.sqrt(float(np.min(squares(nearest * _BETWEEN))))


Model = tuple[Scene, Quadrature, Sequence[Weights], Weights]  # as of `Subject.of`


def rivals(
    scene: Scene,
    model: Subject,
    rival: Model,
    *,
    injections: Sequence[Model],
    errors_K: Mapping[str, Floats],
    delay_s: float | None,
) -> Rivals:
    """Two models in the pixels of the `model`; errors_K has maps (h, w) on the sensor by source."""
    return Rivals(
        scene=scene,
        model=model,
        rival=model.of_model(*rival),
        injections=[model.of_model(*injection) for injection in injections],
        errors_K={name: image.reshape(-1)[model.places] for name, image in errors_K.items()},
        delay_s=delay_s,
    )
