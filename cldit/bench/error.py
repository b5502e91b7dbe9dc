"""Error against run time of every method, on one scene and machine, in one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.bench import ACCURACIES_K
from cldit.bench.case import BenchError, Case, Cost, Lattice, Say, one_pixel
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.weights import Weights
from cldit.transport.trace import Settings

Floats = NDArray[np.float64]

SAMPLES = (128, 256, 512)  # of `path`, a pixel
PLAIN_K = 0.3  # of `source` with one source in thick cells too
REFERENCE_SAMPLES = 512  # of both halves together
_REFERENCE_SEEDS = (7001, 7002)


@dataclass(frozen=True)
class Truth:
    """A converged `path` picture in two independent halves.

    temperature_K: (H, W) T_app of either half. visible: (H, W) pixels that are compared. noise_K:
    RMS over pixels of the standard error of their mean.
    """

    halves: tuple[Weights, Weights]
    temperature_K: tuple[Floats, Floats]
    visible: NDArray[np.bool_]
    noise_K: float
    samples: int

    @classmethod
    def of(cls, case: Case, *, samples: int, phase: Any, order: int | None = None) -> Truth:
        """Makes the reference by path tracing, whatever the scene's method is.

        Args:
            case: to be traced.
            samples: a pixel, in both halves together.
            phase: phase function.
            order: of scattering; None is all orders.

        Raises:
            BenchError: nothing in the picture can be compared.
        """
        half = path_settings(case, samples // 2, phase=phase, order=order)
        first, second = (case.run(replace(half, seed=seed))[0].weights for seed in _REFERENCE_SEEDS)
        temperature_K = case.temperature_K(first), case.temperature_K(second)
        emissivity = 1.0 - (first.background.astype(float) + second.background) / 2
        visible = (emissivity > VISIBLE_EMISSIVITY) & np.isfinite(
            temperature_K[0] + temperature_K[1]
        )
        if not visible.any():
            raise BenchError(
                f"scene {case.scene.name}: no pixel before the background has an emissivity above "
                f"{VISIBLE_EMISSIVITY:g}; there is nothing to compare"
            )
        noise = float(np.sqrt(np.mean((temperature_K[0] - temperature_K[1])[visible] ** 2))) / 2
        return cls((first, second), temperature_K, visible, noise, samples)

    def rms(self, image: Floats, pair: tuple[Floats, Floats]) -> float:
        """RMS over the visible pixels of `image` (H, W) minus the truth, without the truth's noise.

        `pair` are two independent halves (H, W) of the truth: the mean of (x - a)(x - b) holds
        nothing of their noise.
        """
        return self._root((image - pair[0]) * (image - pair[1]))

    def common(self, one: Floats, other: Floats) -> float:
        """RMS of what two independent images (H, W), `one` and `other`, have wrong alike."""
        a, b = self.temperature_K
        return self._root(((one - a) * (other - b) + (one - b) * (other - a)) / 2)

    def _root(self, products: Floats) -> float:
        """Root of the mean over the visible pixels, which noise may have below 0."""
        return float(np.sqrt(max(float(np.nanmean(products[self.visible])), 0.0)))

    def most(self, image: Floats, pair: tuple[Floats, Floats]) -> float:
        """Largest difference of `image` (H, W) from the mean of `pair`, its noise included."""
        return float(np.nanmax(np.abs(image - (pair[0] + pair[1]) / 2)[self.visible]))


@dataclass(frozen=True)
class Row:
    """One method at one setting.

    traced: share of the picture's pixels that were traced. picture_core_s: for all of them, linear
    in the pixels but for what does not depend on them. rms_*, max_*: against the truth, of all
    orders. of_order_K: RMS against `path` of the same order; left_K: what is left of that however
    often the run is repeated, where that was found.
    stated_K: the error that the trace itself estimates, where it does.
    """

    method: str
    label: str
    phase: str
    order: int | None
    traced: float
    core_s: float
    wall_s: float
    picture_core_s: float
    rms_K: float
    max_K: float
    rms_background: float
    max_background: float
    rms_wall: float
    max_wall: float
    stated_K: float | None = None
    of_order_K: float | None = None
    left_K: float | None = None


def path_settings(
    case: Case, samples: int, *, phase: Any, order: int | None = None, seed: int = 11
) -> Settings:
    """Settings of path tracing with a fixed number of samples, whatever the error.

    Args:
        case: to be traced.
        samples: a pixel.
        phase: phase function.
        order: of scattering; None is all orders.
        seed: of the paths.
    """
    settings = case.settings(
        method="path", phase=phase, order=order, max_samples=max(samples, 128), seed=seed
    )
    return replace(settings, accuracy_K=0.0)


@dataclass(frozen=True)
class Compared:
    """The whole picture, and the part of it that is compared, with its truth."""

    case: Case
    lattice: Lattice
    truth: Truth
    phase: str

    @property
    def part(self) -> Case:
        """The case with the lattice's pixels alone."""
        return self.case.seen(self.lattice.of(self.case.scene))

    def row(
        self,
        method: str,
        label: str,
        weights: Weights,
        cost: Cost,
        *,
        fixed_core_s: float | None = None,
        order: int | None = None,
        stated: Weights | None = None,
    ) -> Row:
        """Compares one trace with the truth.

        Args:
            method, label: names in tables.
            weights: of the part.
            cost: of the trace.
            fixed_core_s: what a trace costs without a picture, where the part alone was traced;
                None where the whole picture was.
            order: of scattering; None is all orders.
            stated: the trace's own error, of the part.
        """
        truth, traced, picture_core_s = self.truth, 1.0, cost.core_s
        if fixed_core_s is not None:
            traced = self.lattice.share(self.case.scene)
            picture_core_s = fixed_core_s + max(cost.core_s - fixed_core_s, 0.0) / traced
        temperature_K = self.part.temperature_K(weights)
        one, other = truth.halves
        background = one.background.astype(float), other.background.astype(float)
        wall = one.wall.astype(float), other.wall.astype(float)
        error_K = None
        if stated is not None:
            shifted = Weights.of(
                {name: v + stated.images[name] for name, v in weights.images.items()}
            )
            change = (self.part.temperature_K(shifted) - temperature_K)[truth.visible]
            error_K = float(np.sqrt(np.nanmean(change**2)))
        return Row(
            method=method,
            label=label,
            phase=self.phase,
            order=order,
            traced=traced,
            core_s=cost.core_s,
            wall_s=cost.wall_s,
            picture_core_s=picture_core_s,
            rms_K=truth.rms(temperature_K, truth.temperature_K),
            max_K=truth.most(temperature_K, truth.temperature_K),
            rms_background=truth.rms(weights.background.astype(float), background),
            max_background=truth.most(weights.background.astype(float), background),
            rms_wall=truth.rms(weights.wall.astype(float), wall),
            max_wall=truth.most(weights.wall.astype(float), wall),
            stated_K=error_K,
        )


def bench_error(
    case: Case,
    *,
    phase: str,
    lattice: Lattice,
    say: Say,
    accuracies_K: Sequence[float] = ACCURACIES_K,
    samples: Sequence[int] = SAMPLES,
    reference_samples: int = REFERENCE_SAMPLES,
) -> tuple[list[Row], Truth]:
    """`source` to several accuracies, and `path` with several numbers of samples.

    `source` makes the whole picture; it is compared on the lattice's pixels. `path` traces those
    alone.

    Args:
        case: to be traced.
        phase: phase function.
        lattice: pixels to compare.
        say: takes lines of progress.
        accuracies_K: asked of `source`.
        samples: of `path`, a pixel.
        reference_samples: of the reference, a pixel.

    Returns:
        The rows, and the reference.
    """
    part = case.seen(lattice.of(case.scene))
    empty = case.seen(one_pixel(case.scene))
    say(f"{phase}: reference, {reference_samples} samples in {lattice.share(case.scene):.3g} of it")
    truth = Truth.of(part, samples=reference_samples, phase=phase)
    say(f"{phase}: reference is good to {truth.noise_K:.3f} K")
    bench = Compared(case, lattice, truth, phase)
    rows: list[Row] = []

    def add(row: Row) -> None:
        rows.append(row)
        say(f"{phase}: {row.label}: {row.picture_core_s:.4g} core-s, {row.rms_K:.3f} K RMS")

    case.run(case.settings(phase=phase, accuracy_K=100.0))  # builds
    solved = [(f"source, {k:g} K", {"accuracy_K": k}) for k in accuracies_K]
    solved += [(f"source, no gather, {PLAIN_K:g} K", {"accuracy_K": PLAIN_K, "gather": False})]
    for label, transport in solved:
        result, cost = case.run(case.settings(phase=phase, audit=False, **transport))
        difference = result.weights_difference
        add(
            bench.row(
                "source" if "gather" not in transport else "source, no gather",
                label,
                lattice.pick(case.scene, result.weights),
                cost,
                stated=None if difference is None else lattice.pick(case.scene, difference),
            )
        )
    methods = [
        ("path", f"path, {count} samples", path_settings(case, count, phase=phase))
        for count in samples
    ]
    for method, label, settings in methods:
        fixed = empty.run(settings)[1].core_s
        result, cost = part.run(settings)
        add(
            bench.row(
                method,
                label,
                result.weights,
                cost,
                fixed_core_s=fixed,
                stated=result.weights_difference,
            )
        )
    return rows, truth
