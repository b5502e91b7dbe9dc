"""Distance of two models of a spray by their observables, and the injections that tell them apart.

The observables of a band are T_app and emissivity, each a mean over blocks of pixels as wide as the
scatter between injections is correlated in the image. Where vapour is transparent, the emissivity,
1 - slope of the signals over the background, is the droplets' extinction. The difference d of two
models has with n injections the covariance

    C = D / n + sum_s w_s (U_s U_s' + V_s)        w_s = 1 or 1 / n

with D the noise of the camera of one injection and one reference per background, in which T_app and
emissivity of a block are correlated. U_s are changes of all observables by one standard deviation
of an error s. Of a free parameter this is its derivative times the deviation of its prior: with G
all of these and P the priors' covariance, they add G P G', so that a combination of parameters
that mimics d leaves no more of it than the priors exclude. Errors of the setup
(`cldit.dit.budget`) are such images, too, and have V = 0. Other images are samples of an error
whose next image differs: what the derivatives leave of sprays with drawn parameters and random
numbers (chance and curvature), and the step to wider cells. They count once as images, and once
as V, independent from block to block. Its block diagonal is that of U U' for M images, with the
mean of all blocks as one sample more,

    V = (M [U U'] + mean [U U']) / (M + 1)

since a spray reaches blocks that a few samples leave dark. Means of n injections have 1 / n of it.

The likelihood ratio of the models then has the distance (generalised least squares)

    z = (d' C^-1 d)^1/2

in standard deviations, and a test at the level of 1 % finds the difference in 95 % of all
measurements if z is at least 3.97.
"""

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cldit.arrays import Floats, Mask
from cldit.dit.budget import budget
from cldit.dit.design import MOST_SHOTS, BlackBody, temperatures_K
from cldit.dit.maps import Maps, Reason
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings
from cldit.scene.schema import Scene

LEVEL, POWER = 0.01, 0.95
NEEDED = float(ndtri(1.0 - LEVEL) + ndtri(POWER))
OBSERVABLES = ("T_app", "emissivity")
_LEVELS = 5  # of the lowest and of the highest background that are tried


@dataclass(frozen=True, kw_only=True)
class Source:
    """Changes (M, B, 2) of the observables of B blocks by one standard deviation of M errors.

    by_injection: True if the errors of n injections are independent. independent: (B, 2, 2)
    covariance of a part that is independent from block to block.
    """

    name: str
    images: Floats
    by_injection: bool = False
    independent: Floats | float = 0.0

    @classmethod
    def sampled(cls, name: str, images: Floats, *, by_injection: bool = False) -> "Source":
        """A source whose images are samples, the sum of whose squares is the variance."""
        blocks = np.einsum("mbi,mbj->bij", images, images)
        count = len(images)
        independent = (count * blocks + blocks.mean(axis=0)) / (count + 1)
        return cls(name=name, images=images, by_injection=by_injection, independent=independent)


@dataclass(frozen=True, kw_only=True)
class SeparationTest:
    """Difference (B, 2) of two models, its noise (B, 2, 2), and the errors of other sources."""

    change: Floats
    noise: Floats
    sources: tuple[Source, ...] = ()

    @classmethod
    def joined(cls, tests: Sequence["SeparationTest"]) -> "SeparationTest":
        """The test of several bands: fixed errors of one name are the same error in all of them.

        Each band has injections of its own.
        """
        sizes = [len(test.change) for test in tests]
        sources: dict[tuple[str, int], Source] = {}
        for number, test in enumerate(tests):
            for source in test.sources:
                padded = [np.zeros((len(source.images), size, 2)) for size in sizes]
                covariances = [np.zeros((size, 2, 2)) for size in sizes]
                padded[number] = source.images
                covariances[number] = covariances[number] + source.independent
                images, independent = np.concatenate(padded, axis=1), np.concatenate(covariances)
                key = source.name, number if source.by_injection else -1
                if key in sources:
                    images = images + sources[key].images
                    independent = independent + sources[key].independent
                sources[key] = replace(source, images=images, independent=independent)
        return cls(
            change=np.concatenate([test.change for test in tests]),
            noise=np.concatenate([test.noise for test in tests]),
            sources=tuple(sources.values()),
        )

    def without(self, *names: str) -> "SeparationTest":
        """The same without some sources; without any names, with noise alone."""
        kept = [source for source in self.sources if names and source.name not in names]
        return replace(self, sources=tuple(kept))

    def distance(self, shots: float, observables: Iterable[str] = OBSERVABLES) -> float:
        """z with so many injections, and references, per background, of some observables."""
        return math.sqrt(self.product(self.change, self.change, shots, observables))

    def score(
        self, residual: Floats, shots: float, observables: Iterable[str] = OBSERVABLES
    ) -> float:
        """Likelihood ratio in standard deviations, of data less the first model, (B, 2).

        It is normal, of variance 1, about 0 if the first model is true and about z if the second.
        """
        return self.product(self.change, residual, shots, observables) / self.distance(
            shots, observables
        )

    def product(
        self, a: Floats, b: Floats, shots: float, observables: Iterable[str] = OBSERVABLES
    ) -> float:
        """a' C^-1 b, by Woodbury's identity.

        It is a sum of what the images leave and of their sizes; as a difference it would lose all
        digits.
        """
        used = [OBSERVABLES.index(name) for name in observables]
        blocks = self.noise / shots
        rows = [np.zeros((0, *self.change.shape))]
        for source in self.sources:
            share = 1.0 / shots if source.by_injection else 1.0
            rows.append(source.images * math.sqrt(share))
            blocks = blocks + source.independent * share
        precision = np.zeros_like(blocks)
        at = np.ix_(range(len(blocks)), used, used)
        precision[at] = np.linalg.inv(blocks[at])
        u = np.concatenate(rows)
        weighted = np.einsum("mbi,bij->mbj", u, precision)
        inner = np.eye(len(u)) + np.einsum("mbj,kbj->mk", weighted, u)
        pair = np.stack([a, b])
        sizes = np.linalg.solve(inner, np.einsum("mbj,kbj->mk", weighted, pair))
        rest = pair - np.einsum("mk,mbj->kbj", sizes, u)
        unexplained = np.einsum("bi,bij,bj->", rest[0], precision, rest[1])
        return float(unexplained + sizes[:, 0] @ sizes[:, 1])


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The fastest plan at one delay and band that separates two models, or the nearest to it.

    shots: injections, and references, per background; None: no number of them does. distance: z of
    the plan, or of the most shots; distances: of each observable alone. of_noise: z for the same
    shots with the camera's noise alone. time_s: None if none is enough; includes the waiting for
    the black body. rms_K, rms_emissivity: of the difference. largest: error that all shots share
    without which z would rise most.
    """

    delay_s: float | None
    band: str
    backgrounds_K: tuple[float, ...]
    shots: int | None
    distance: float
    distances: Mapping[str, float]
    of_noise: float
    time_s: float | None
    rms_K: float
    rms_emissivity: float
    largest: str = ""

    @property
    def order(self) -> tuple[float, float]:
        """Sorts the fastest plan to the front, or the one that comes nearest."""
        return (math.inf if self.time_s is None else self.time_s, -self.distance)

    @property
    def text(self) -> str:
        """Conclusion on one line."""
        band = f" in the band of {self.band}" if self.band else ""
        if self.shots is not None:
            return (
                f"{self.shots} injections and references at each of {len(self.backgrounds_K)} "
                f"backgrounds{band} tell them apart: {self.distance:.1f} standard deviations"
            )
        if self.rms_K == self.rms_emissivity == 0.0:
            return "undecided: both models have the same T_app and emissivity"
        limit = f"; most of the error: {self.largest}" if self.largest else ""
        return (
            f"undecided{band}: {MOST_SHOTS} injections leave {self.distance:.1f} standard "
            f"deviations, and {NEEDED:.2g} are needed{limit}"
        )


@dataclass(frozen=True, kw_only=True)
class Rivals:
    """Two models in one view, band and delay, as signals of the same pixels.

    about: the spray whose changes the other ones are. unknowns: with one free parameter larger by
    the deviation of its prior, by name. draws: with parameters so many deviations larger (P,) and
    other random numbers. members: single injections; none: they differ as the draws do. coarser:
    with wider cells. errors: (2, N) of T_app and emissivity of the simulations, by source.
    """

    scene: Scene
    model: Subject
    rival: Subject
    about: Subject
    unknowns: Mapping[str, Subject] = field(default_factory=dict)
    draws: Sequence[tuple[Floats, Subject]] = ()
    members: Sequence[Subject] = ()
    coarser: Sequence[Subject] = ()
    errors: Mapping[str, Floats] = field(default_factory=dict)
    delay_s: float | None = None
    band: str = ""

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
        test, shots = self.test(best.backgrounds_K), best.shots or MOST_SHOTS
        z = {item.name: test.without(item.name).distance(shots) for item in test.sources}
        return replace(best, largest=max(z, key=lambda name: z[name], default=""))

    def at(
        self, backgrounds_K: tuple[float, ...], blackbody: BlackBody, *, shot_s: float
    ) -> Separation:
        """The fewest shots that tell the models apart with these backgrounds."""
        test = self.test(backgrounds_K)
        shots = fewest(test)
        taken = MOST_SHOTS if shots is None else shots
        waiting_s = blackbody.time_s(backgrounds_K)
        rms = np.sqrt(np.mean(test.change**2, axis=0))
        return Separation(
            delay_s=self.delay_s,
            band=self.band,
            backgrounds_K=backgrounds_K,
            shots=shots,
            distance=test.distance(taken),
            distances={name: test.distance(taken, [name]) for name in OBSERVABLES},
            of_noise=test.without().distance(taken),
            time_s=shots and waiting_s + 2 * shots * len(backgrounds_K) * shot_s,
            rms_K=float(rms[0]),
            rms_emissivity=float(rms[1]),
        )

    def test(self, backgrounds_K: tuple[float, ...]) -> SeparationTest:
        """The test with one set of backgrounds."""
        at, change, blocks = self._seen(backgrounds_K)
        share = self.model.pixels / self.model.places.size
        return SeparationTest(
            change=blocks.mean(change),
            noise=blocks.variance(self.model.calm.covariance(backgrounds_K)) / share,
            sources=tuple(self._sources(backgrounds_K, at, blocks)),
        )

    def data(self, true: Subject, backgrounds_K: tuple[float, ...]) -> Floats:
        """Observables (B, 2) of another spray less those of the model, in the blocks of `test`."""
        at, _, blocks = self._seen(backgrounds_K)
        return blocks.mean(true.calm.observables(backgrounds_K) - at)

    def _seen(self, backgrounds_K: tuple[float, ...]) -> tuple[Floats, Floats, "_Blocks"]:
        """Observables (2, N) of the model, those of its rival less these, and the blocks."""
        at = self.model.calm.observables(backgrounds_K)
        change = self.rival.calm.observables(backgrounds_K) - at
        finite = np.asarray(np.isfinite(change).all(axis=0))
        if not finite.any():
            raise EvaluationError("no pixel has a T_app with both models")
        return at, change, _Blocks.of(self.scene, self.model, np.nan_to_num(at[1]), finite)

    def _sources(
        self, backgrounds_K: tuple[float, ...], at: Floats, blocks: "_Blocks"
    ) -> Iterator[Source]:
        calm = self.model.calm
        # The simulated rig's field of optical depths: a common part, and a smooth one, which is
        # independent in blocks of its correlation length.
        depth = calm.depth_response(*calm.both(backgrounds_K))
        depth = calm.response(backgrounds_K) * depth * self.model.scatter / math.sqrt(2.0)
        images = blocks.mean(np.swapaxes(depth, 0, 1))
        yield Source.sampled("optical depth", images, by_injection=True)
        nominal = self.about.calm.observables(backgrounds_K)

        def changes(subjects: Iterable[Subject]) -> Floats:
            seen = [subject.calm.observables(backgrounds_K) - nominal for subject in subjects]
            return blocks.mean(np.array(seen))

        derivatives = [changes([subject]) for subject in self.unknowns.values()]
        for name, images in zip(self.unknowns, derivatives, strict=True):
            yield Source(name=name, images=images)
        if self.draws:
            unexplained = changes(subject for _, subject in self.draws)
            for number, (deviations, _) in enumerate(self.draws):
                for size, images in zip(deviations, derivatives, strict=True):
                    unexplained[number] -= size * images[0]
            unexplained /= math.sqrt(len(unexplained))
            yield Source.sampled("random numbers and curvature", unexplained)
            if not self.members:
                yield Source.sampled("injections", unexplained, by_injection=True)
        if len(self.members) > 1:
            seen = changes(self.members)
            seen = (seen - seen.mean(axis=0)) / math.sqrt(len(seen) - 1)
            yield Source.sampled("injections", seen, by_injection=True)
        if self.coarser:
            yield Source.sampled("cells", changes(self.coarser))
        for name, error in self.errors.items():
            yield Source.sampled(name, blocks.mean(error[None]))
        maps = Maps.unevaluated((1, at.shape[1]), Reason.OK)
        maps = replace(
            maps,
            apparent_temperature_K=at[:1].astype(np.float32),
            emissivity=at[1:].astype(np.float32),
        )
        setup = budget(
            maps,
            Surroundings.from_scene(self.scene),
            curve=self.model.curve,
            backgrounds_K=backgrounds_K,
            calibration=self.model.exposure(max(backgrounds_K)).calibration(),
        )
        for part in setup.parts:
            images = np.stack([part.kelvin, part.emissivity], axis=1)
            yield Source(name=part.name, images=blocks.mean(images))


def fewest(test: SeparationTest, observables: Sequence[str] = OBSERVABLES) -> int | None:
    """Fewest injections that tell two models apart; None: not even the most."""
    if test.distance(MOST_SHOTS, observables) < NEEDED:
        return None
    return bisect_left(range(MOST_SHOTS), NEEDED, lo=1, key=lambda n: test.distance(n, observables))


@dataclass(frozen=True)
class _Blocks:
    """Blocks of pixels: number (N,) of each pixel's, weights (2, N) of T_app and emissivity."""

    number: NDArray[np.intp]
    weights: Floats

    @classmethod
    def of(cls, scene: Scene, subject: Subject, emissivity: Floats, where: Mask) -> "_Blocks":
        """Blocks as wide as the scatter is correlated; T_app is known as the emissivity squared."""
        columns, rows = scene.camera.sensor.pixels
        row, column = np.divmod(subject.places, columns)
        edges = [
            max(1, round(scene.spray.scatter.length_m / (width_m / count)))
            for width_m, count in zip(scene.camera.field_m, (columns, rows), strict=True)
        ]
        wide = -(-columns // edges[0])
        _, number = np.unique(row // edges[1] * wide + column // edges[0], return_inverse=True)
        weights = np.stack([emissivity**2, np.ones_like(emissivity)]) * where
        total = np.stack([np.bincount(number, weight) for weight in weights])
        kept = np.all(total > 0.0, axis=0)
        weights = np.where(kept[number], weights / np.maximum(total, 1e-300)[:, number], 0.0)
        return cls(np.where(kept[number], np.cumsum(kept)[number] - 1, 0), weights)

    def mean(self, values: Floats) -> Floats:
        """Means (.., B, 2) of values (.., 2, N); a value that is not known counts as 0."""
        count = int(self.number.max()) + 1
        flat = np.nan_to_num(values.reshape(-1, 2, values.shape[-1])) * self.weights
        seen = [[np.bincount(self.number, row, count) for row in pair] for pair in flat]
        return np.swapaxes(np.array(seen), 1, 2).reshape(*values.shape[:-2], count, 2)

    def variance(self, covariance: Floats) -> Floats:
        """Covariance (B, 2, 2) of means of independent pixels (2, N, 2)."""
        scaled = np.einsum("in,inj,jn->ijn", self.weights, np.nan_to_num(covariance), self.weights)
        count = int(self.number.max()) + 1
        sums = [[np.bincount(self.number, part, count) for part in row] for row in scaled]
        return np.moveaxis(np.array(sums), -1, 0)
