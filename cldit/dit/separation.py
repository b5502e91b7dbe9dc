"""Distance of two models of a spray by their observables, and the injections that tell them apart.

The observables of a band are T_app and emissivity (the droplets' extinction, where vapour is
transparent), each a mean over blocks of pixels as wide as the scatter between injections is
correlated in the image. The difference d of two models has with n injections the covariance

    C = D / n + sum_s w_s (U_s U_s' + V_s)        w_s = 1 or 1 / n

with D the noise of the camera of one injection and one reference per background, in which T_app and
emissivity of a block are correlated. U_s are changes of all observables by one standard deviation
of an error s: of a free parameter its derivative times the deviation of its prior, so that a
combination of parameters that mimics d leaves no more of it than the priors exclude; likewise of
the setup (`cldit.dit.budget`), with V = 0. Other images are samples of an error whose next image
differs: what the derivatives leave of sprays with drawn parameters and random numbers (chance and
curvature), and the step to wider cells. They count once as images, and once as V, independent from
block to block: V = (M [U U'] + mean [U U']) / (M + 1) for M images, as a spray reaches blocks that
a few samples leave dark. Means of n injections have 1 / n of it.

A measurement less the first model, r, has the score (generalised least squares)

    s = w' r        w = C^-1 d / z        z = (d' C^-1 d)^1/2

which is normal, of variance 1, about 0 or z, if C and d are known. They are not: a few draws miss
directions in which sprays differ, which w prefers; the derivatives are those of one model; and d
contains the random numbers of two single runs. So M draws of each model calibrate the score: draw
k, less its linear part, has the score w_k' r_k, with weights w_k that leave it out. With their mean
m and variance v, and the variance q = w' (C - draws) w of all other errors,

    (s - m) / (q + v + v / M)^1/2

of a measurement of this model follows Student's t with (1 + q / (v + v / M))^2 (M - 1) degrees of
freedom (Welch 1947). More injections do not reduce v, as draws do not tell chance from curvature.
The distance of both predictions has the unit in which a test at the level of 1 % finds the
difference in 95 % of all measurements if it is at least 3.97; without draws it is z.
"""

import math
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr, stdtrit

from cldit.arrays import Floats, Mask
from cldit.dit.budget import budget
from cldit.dit.design import MOST_SHOTS, BlackBody, background_sets
from cldit.dit.maps import Maps, Reason
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.radiance.boundary import Surroundings
from cldit.scene.schema import Scene

LEVEL, POWER = 0.01, 0.95
NEEDED = float(ndtri(1.0 - LEVEL) + ndtri(POWER))
OBSERVABLES = ("T_app", "emissivity")
DRAWS = "random numbers and curvature"


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
        independent = (len(images) * blocks + blocks.mean(axis=0)) / (len(images) + 1)
        return cls(name=name, images=images, by_injection=by_injection, independent=independent)


@dataclass(frozen=True)
class Prediction:
    """Score of a measurement if a model is true: mean + deviation t, Student's t of `degrees`."""

    mean: float
    deviation: float = 1.0
    degrees: float = math.inf

    @classmethod
    def of(cls, scores: Sequence[float], variance: float) -> "Prediction":
        """Prediction by scores of draws, and the variance of errors that these do not contain."""
        sampled = float(np.var(scores, ddof=1)) * (1.0 + 1.0 / len(scores))
        degrees = (1.0 + variance / sampled) ** 2 * (len(scores) - 1) if sampled > 0.0 else math.inf
        return cls(float(np.mean(scores)), math.sqrt(variance + sampled), degrees)

    def reach(self, probability: float) -> float:
        """Distance from the mean that is exceeded on one side with this probability."""
        return self.deviation * float(stdtrit(self.degrees, 1.0 - probability))


@dataclass(frozen=True, kw_only=True)
class SeparationTest:
    """Difference (B, 2) of two models, its noise (B, 2, 2), and the errors of other sources.

    draws: of the first and of the second model, (2, M, B, 2): single injections with drawn
    parameters, the same ones of both, less their model and its linear change; without any, C and
    the difference are taken as known.
    """

    change: Floats
    noise: Floats
    sources: tuple[Source, ...] = ()
    draws: Floats | None = None

    @classmethod
    def joined(cls, tests: Sequence["SeparationTest"]) -> "SeparationTest":
        """The test of several bands: fixed errors of one name are the same error in all of them.

        Each band has injections of its own; a draw is one injection that all bands see.
        """
        ends = np.cumsum([len(test.change) for test in tests])
        sources: dict[tuple[str, int], Source] = {}
        for number, test in enumerate(tests):
            blocks = slice(ends[number] - len(test.change), ends[number])
            for source in test.sources:
                images = np.zeros((len(source.images), ends[-1], 2))
                independent = np.zeros((ends[-1], 2, 2))
                images[:, blocks], independent[blocks] = source.images, source.independent
                key = source.name, number if source.by_injection else -1
                if key in sources:
                    images = images + sources[key].images
                    independent = independent + sources[key].independent
                sources[key] = replace(source, images=images, independent=independent)
        draws = [test.draws for test in tests if test.draws is not None]
        return cls(
            change=np.concatenate([test.change for test in tests]),
            noise=np.concatenate([test.noise for test in tests]),
            sources=tuple(sources.values()),
            draws=np.concatenate(draws, axis=2) if draws else None,
        )

    def without(self, *names: str) -> "SeparationTest":
        """The same without some sources; without any names, with noise alone."""
        kept = tuple(source for source in self.sources if names and source.name not in names)
        draws = self.draws if names and DRAWS not in names else None
        return replace(self, sources=kept, draws=draws)

    def distance(self, shots: float, observables: Iterable[str] = OBSERVABLES) -> float:
        """Distance of the models by so many injections, and references, per background."""
        of_model, of_rival = self.predictions(shots, observables)
        needed = max(
            of_model.reach(LEVEL) + of_rival.reach(1.0 - POWER),
            of_rival.reach(LEVEL) + of_model.reach(1.0 - POWER),
        )
        return NEEDED * max(of_rival.mean - of_model.mean, 0.0) / max(needed, 1e-300)

    def p_values(
        self, residual: Floats, shots: float, observables: Iterable[str] = OBSERVABLES
    ) -> tuple[float, float]:
        """Probabilities, if either model is true, of data that are as far towards the other one.

        residual: data less the first model, (B, 2).
        """
        score = float(np.sum(self._weights(shots, observables)[0] * residual))
        of_model, of_rival = self.predictions(shots, observables)
        excesses = ((of_model, score - of_model.mean), (of_rival, of_rival.mean - score))
        chances = [float(stdtr(item.degrees, -off / item.deviation)) for item, off in excesses]
        return chances[0], chances[1]

    def predictions(
        self, shots: float, observables: Iterable[str] = OBSERVABLES
    ) -> tuple[Prediction, Prediction]:
        """Scores of a measurement if the first model is true, and if the second."""
        weights, z = self._weights(shots, observables)
        if self.draws is None:
            return Prediction(0.0), Prediction(z)
        variance = np.einsum("bi,bij,bj->", weights, self.noise, weights) / shots
        for source in self.sources:
            square = np.sum(np.einsum("mbi,bi->m", source.images, weights) ** 2)
            square += np.sum(weights[:, :, None] * weights[:, None] * source.independent)
            variance += square / (shots if source.by_injection else 1.0)
        scores = []
        for number, pair in enumerate(np.swapaxes(self.draws, 0, 1)):
            fold = replace(self, draws=np.delete(self.draws, number, axis=1))
            scores.append(np.sum(fold._weights(shots, observables)[0] * pair, axis=(1, 2)))
        sides = zip(*scores, strict=True)
        of_model, of_rival = (Prediction.of(side, float(variance)) for side in sides)
        return of_model, replace(of_rival, mean=of_rival.mean + z)

    def _weights(self, shots: float, observables: Iterable[str]) -> tuple[Floats, float]:
        """Weights w (B, 2) of the score, and z, by Woodbury's identity: z^2 as a sum of what the
        images leave and of their sizes, as a difference would lose all digits."""
        used = [OBSERVABLES.index(name) for name in observables]
        blocks = self.noise / shots
        rows = [np.zeros((0, *self.change.shape))]
        shares = [(source, 1.0 / shots if source.by_injection else 1.0) for source in self.sources]
        if self.draws is not None:
            draws = self.draws.reshape(-1, *self.change.shape)
            shares.append((Source.sampled(DRAWS, draws / len(draws) ** 0.5), 1.0 + 1.0 / shots))
        for source, share in shares:
            rows.append(source.images * math.sqrt(share))
            blocks = blocks + source.independent * share
        precision = np.zeros_like(blocks)
        at = np.ix_(range(len(blocks)), used, used)
        precision[at] = np.linalg.inv(blocks[at])
        u = np.concatenate(rows)
        weighted = np.einsum("mbi,bij->mbj", u, precision)
        inner = np.eye(len(u)) + np.einsum("mbj,kbj->mk", weighted, u)
        sizes = np.linalg.solve(inner, np.einsum("mbj,bj->m", weighted, self.change))
        rest = self.change - np.einsum("m,mbj->bj", sizes, u)
        weights = np.einsum("bij,bj->bi", precision, rest)
        z = math.sqrt(float(np.sum(weights * rest) + sizes @ sizes))
        return weights / max(z, 1e-300), z


@dataclass(frozen=True, kw_only=True)
class Separation:
    """The fastest plan at one delay and band that separates two models, or the nearest to it.

    shots: injections, and references, per background; None: no number of them does. distance: of
    the plan, or of the most shots; distances: of each observable alone. of_noise: for the same
    shots with the camera's noise alone. time_s: None if none is enough; includes the waiting for
    the black body. rms_K, rms_emissivity: of the difference. largest: error that all shots share
    without which the distance would rise most.
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
        return self.time_s or math.inf, -self.distance

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
    the deviation of its prior, by name. draws: parameters so many deviations larger (P,), and the
    model and its rival with these and other random numbers; none, or at least three. coarser: with
    wider cells. errors: (2, N) of T_app and emissivity of the simulations, by source.
    """

    scene: Scene
    model: Subject
    rival: Subject
    about: Subject
    unknowns: Mapping[str, Subject] = field(default_factory=dict)
    draws: Sequence[tuple[Floats, Subject, Subject]] = ()
    coarser: Sequence[Subject] = ()
    errors: Mapping[str, Floats] = field(default_factory=dict)
    delay_s: float | None = None
    band: str = ""

    def best(
        self, blackbody: BlackBody, *, shot_s: float, counts: Sequence[int] = (2, 3, 5, 7)
    ) -> Separation:
        """The fastest of all sets of backgrounds within the limits."""
        tried = [item for count in counts for item in background_sets(blackbody.limits_K, count)]
        if not tried:
            raise EvaluationError(
                f"backgrounds: {blackbody.limits_K[0]:g} K alone; two models are separated with "
                "two or more"
            )
        plans = [self._plan(backgrounds, blackbody, shot_s) for backgrounds in tried]
        best = min(plans, key=lambda plan: plan.order)
        test, shots = self.test(best.backgrounds_K), best.shots or MOST_SHOTS
        names = [source.name for source in test.sources] + [DRAWS] * (test.draws is not None)
        distances = {name: test.without(name).distance(shots) for name in names}
        return replace(best, largest=max(distances, key=lambda name: distances[name], default=""))

    def _plan(self, backgrounds_K: tuple[float, ...], body: BlackBody, shot_s: float) -> Separation:
        """The fewest shots that tell the models apart with these backgrounds."""
        test = self.test(backgrounds_K)
        shots = fewest(test)
        taken = shots or MOST_SHOTS
        rms = np.sqrt(np.mean(test.change**2, axis=0)).tolist()
        return Separation(
            delay_s=self.delay_s,
            band=self.band,
            backgrounds_K=backgrounds_K,
            shots=shots,
            distance=test.distance(taken),
            distances={name: test.distance(taken, [name]) for name in OBSERVABLES},
            of_noise=test.without().distance(taken),
            time_s=shots and body.time_s(backgrounds_K) + 2 * shots * len(backgrounds_K) * shot_s,
            rms_K=rms[0],
            rms_emissivity=rms[1],
        )

    def test(self, backgrounds_K: tuple[float, ...]) -> SeparationTest:
        """The test with one set of backgrounds."""
        at, change, blocks = self._seen(backgrounds_K)

        def changes(subjects: Iterable[Subject], nominal: Subject) -> Floats:
            observables = nominal.calm.observables(backgrounds_K)
            images = [subject.calm.observables(backgrounds_K) for subject in subjects]
            return blocks.mean(np.array(images).reshape(-1, *observables.shape) - observables)

        derivatives = changes(self.unknowns.values(), self.about)
        draws = None
        if self.draws:
            sizes, samples, rivals = zip(*self.draws, strict=True)
            linear = np.einsum("mp,pbi->mbi", np.array(sizes), derivatives)
            draws = np.stack([changes(samples, self.model), changes(rivals, self.rival)]) - linear
        images = derivatives[:, None]
        sources = [Source(name=n, images=i) for n, i in zip(self.unknowns, images, strict=True)]
        if self.coarser:
            sources.append(Source.sampled("cells", changes(self.coarser, self.about)))
        sources += [Source.sampled(name, blocks.mean(e[None])) for name, e in self.errors.items()]
        calm = self.model.calm
        # The simulated rig's field of optical depths: a common part, and a smooth one, which is
        # independent in blocks of its correlation length.
        depth = calm.depth_response(*calm.both(backgrounds_K))
        depth = calm.response(backgrounds_K) * depth * self.model.scatter / math.sqrt(2.0)
        images = blocks.mean(np.swapaxes(depth, 0, 1))
        sources.append(Source.sampled("optical depth", images, by_injection=True))
        kelvin, emissivity = at.astype(np.float32)[:, None]
        maps = Maps.unevaluated(kelvin.shape, Reason.OK)
        setup = budget(
            replace(maps, apparent_temperature_K=kelvin, emissivity=emissivity),
            Surroundings.from_scene(self.scene),
            curve=self.model.curve,
            backgrounds_K=backgrounds_K,
            calibration=self.model.exposure(max(backgrounds_K)).calibration(),
        )
        for part in setup.parts:
            images = blocks.mean(np.stack([part.kelvin, part.emissivity], axis=1))
            sources.append(Source(name=part.name, images=images))
        share = self.model.pixels / self.model.places.size
        return SeparationTest(
            change=blocks.mean(change),
            noise=blocks.variance(calm.covariance(backgrounds_K)) / share,
            sources=tuple(sources),
            draws=draws,
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


def fewest(test: SeparationTest, observables: Sequence[str] = OBSERVABLES) -> int | None:
    """Fewest injections that tell two models apart; None: not even the most."""
    if test.distance(1, observables) >= NEEDED:
        return 1
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
        seen = [np.bincount(self.number, row, count) for pair in flat for row in pair]
        pairs = np.reshape(seen, (*values.shape[:-2], 2, count))
        return np.swapaxes(pairs, -2, -1)

    def variance(self, covariance: Floats) -> Floats:
        """Covariance (B, 2, 2) of means of independent pixels (2, N, 2)."""
        scaled = np.einsum("in,inj,jn->ijn", self.weights, np.nan_to_num(covariance), self.weights)
        count = int(self.number.max()) + 1
        sums = [[np.bincount(self.number, part, count) for part in row] for row in scaled]
        return np.moveaxis(np.array(sums), -1, 0)
