"""Mean light of several runs of the same pixels: injections, or times of an exposure."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.camera.sensor import SensorModel
from cldit.dit.evaluate import evaluated, sensor_of
from cldit.dit.maps import Maps
from cldit.optics.spectral import Quadrature
from cldit.radiance.weights import Weights, mean
from cldit.run.result import Run
from cldit.scene import Scene


@dataclass(frozen=True)
class MeanLight:
    """Mean of runs, evaluated: weights of the whole filter, without spray and of each node.

    remark: for the user, where wavelengths of the runs differ; else empty. rays: (H, W) mean
    number of rays of a pixel; None if a run does not have it.
    """

    weights: Weights
    reference: Weights
    spectral: tuple[Weights, ...]
    quadrature: Quadrature
    sensor: SensorModel
    maps: Maps
    remark: str
    rays: NDArray[np.float32] | None

    @classmethod
    def of(
        cls,
        scene: Scene,
        runs: Iterable[Run],
        base: Run,
        *,
        label: str,
        shares: Sequence[float] | None = None,
    ) -> "MeanLight":
        """Mean of `runs`, which are taken one by one.

        Args:
            scene: whose camera and boundary all runs have.
            base: run with the wavelengths that all should have.
            label: plural noun for the runs, for the remark.
            shares: in proportion to the part of each run; None: equal.
        """
        sharing: list[bool] = []
        rays: list[NDArray[np.float32] | None] = []

        def stacked_weights() -> Iterator[Weights]:
            for run in runs:
                sharing.append(run.quadrature == base.quadrature)
                rays.append(run.rays)
                yield _joined(run if sharing[-1] else replace(run, spectral=(run.weights,)))

        mixed = mean(stacked_weights(), shares)
        nodes = len(base.spectral) if all(sharing) else 1
        weights, reference, *spectral = (
            mixed.map(lambda image, n=number: image[n])  # type: ignore[misc]
            for number in range(2 + nodes)
        )
        quadrature, remark = base.quadrature, ""
        if not all(sharing):
            at_K = quadrature.reference_K
            quadrature = Quadrature.grey(quadrature.filter_um, reference_K=at_K)
            remark = (
                f"{label} have different wavelengths: their mean is exact for a background of "
                f"{at_K:g} K, and approximate for others"
            )
        evaluated_weights = (tuple(spectral), reference)
        sensor = sensor_of(scene, quadrature, evaluated_weights)
        maps = evaluated(scene, quadrature, *evaluated_weights, sensor)
        recorded = [image for image in rays if image is not None]
        complete = len(recorded) == len(rays)
        number = np.asarray(np.mean(recorded, axis=0), np.float32) if complete else None
        return cls(weights, reference, tuple(spectral), quadrature, sensor, maps, remark, number)

    def run(self, scene: Scene, base: Run, folder: Path | None, remark: str) -> Run:
        """The run of the mean: its run `base` with the mean's images, and a remark."""
        remarks = (remark, self.remark) if self.remark else (remark,)
        info = replace(
            base.info,
            remarks=(*base.info.remarks, *remarks),
            integration_time_s=self.sensor.integration_time_s,
        )
        return replace(
            base,
            scene=scene,
            weights=self.weights,
            reference=self.reference,
            maps=self.maps,
            info=info,
            quadrature=self.quadrature,
            spectral=self.spectral,
            rays=self.rays,
            folder=folder,
        )


def _joined(run: Run) -> Weights:
    """All weights of a run as one, whose images are stacked."""
    parts = (run.weights, run.reference, *run.spectral)
    return Weights.of(
        {name: np.stack([part.images[name] for part in parts]) for name in run.weights.images}
    )
