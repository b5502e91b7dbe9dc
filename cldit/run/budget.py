"""Measuring what each cause of the simulation adds to the error of T_app.

A cause is found by a second trace in which it alone differs: on cells twice as large, with either
half of the parcels, with parcels spread less. Both traces have the same ordinates, whose own error
so cancels. They are of one wavelength, the middle one, for that is what the medium looks like in
all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cldit.dit.accuracy import VISIBLE_EMISSIVITY
from cldit.errors import TransportError
from cldit.gpu.device import Device
from cldit.medium.frame import Frame
from cldit.medium.octree import Sources, build_octrees
from cldit.optics.spectral import SpectralNode
from cldit.radiance.weights import Weights
from cldit.run.errors import Cause
from cldit.run.node_temperature import NodeTemperature
from cldit.scene import Scene
from cldit.transport.cells import OpticalCells
from cldit.transport.trace import Settings, trace
from cldit.transport.view import View

Floats = NDArray[np.float64]

# The bias of the width falls with its fourth power: from a variance to its half goes 3/4 of it.
_OF_WIDTH = 4.0 / 3.0


@dataclass(frozen=True)
class ParcelVariants:
    """Sources of one wavelength in which the parcels differ; see `cldit.medium.cloud.Variants`.

    sampling: error by sampling over the halves' difference.
    """

    halves: tuple[Sources, Sources]
    narrower: Sources | None
    sampling: float


@dataclass(frozen=True)
class Probed:
    """What the causes of the medium are measured on.

    frame, sources: of the traced medium, at the wavelength of `node`, its `number`. parcels: None
    where the
    droplets are no sample. gas: why the error of the gas's own grid is not known; empty: there is
    no gas, or it has no error of its own.
    """

    frame: Frame
    sources: Sources
    number: int
    node: SpectralNode
    parcels: ParcelVariants | None
    gas: str
    optical_depth_split: float


@dataclass(frozen=True)
class Budget:
    """Traces variants of a medium, and compares them with it."""

    scene: Scene
    device: Device
    settings: Settings
    probed: Probed

    def traced(self) -> Weights:
        """The medium itself, by the budget's settings."""
        return self._traced(self.probed.sources, self.probed.frame)

    def causes(self, weights: Weights, say: Callable[[str], None] | None) -> list[Cause | None]:
        """The errors of cells, parcels, width and gas.

        Args:
            weights: of the traced medium, at the node's wavelength.
            say: told of each trace.

        Returns:
            A cause each; None for one that the scene has not.
        """
        tell = say or (lambda _: None)
        temperature = self._temperature(weights)
        return [
            self._cells(temperature, weights, tell),
            *self._parcels(temperature, weights, tell),
            Cause("gas grid", None, self.probed.gas) if self.probed.gas else None,
        ]

    def _cells(
        self, temperature: NodeTemperature, weights: Weights, tell: Callable[[str], None]
    ) -> Cause:
        frame = self.probed.frame
        if frame.depth == 0:
            return Cause("cells", None, "one cell: there are no larger ones to compare with")
        tell("errors: cells twice as large")
        coarse = replace(frame, depth=frame.depth - 1)
        try:
            other = self._traced(self.probed.sources, coarse)
        except TransportError as wrong:  # larger cells reach behind a patch
            return Cause("cells", None, f"cells of {coarse.cell_m * 1e3:.3g} mm: {wrong}")
        error = difference_K(temperature, weights, other)
        return Cause(
            "cells",
            error,
            f"cells of {coarse.cell_m * 1e3:.3g} mm for {frame.cell_m * 1e3:.3g} mm: the error "
            "of the first order is that of the step"
            if error is not None
            else "no pixel has a T_app on either",
        )

    def _parcels(
        self, temperature: NodeTemperature, weights: Weights, tell: Callable[[str], None]
    ) -> list[Cause]:
        parcels = self.probed.parcels
        if parcels is None:
            return []
        tell("errors: either half of the parcels")
        one, other = (self._traced(half, self.probed.frame) for half in parcels.halves)
        sampling = difference_K(temperature, one, other)
        causes = [
            Cause(
                "parcels",
                None if sampling is None else parcels.sampling * sampling,
                f"{parcels.sampling:g} of the difference of two halves of the parcels",
            )
        ]
        if parcels.narrower is not None:
            tell("errors: parcels spread less")
            narrow = difference_K(
                temperature, weights, self._traced(parcels.narrower, self.probed.frame)
            )
            causes.append(
                Cause(
                    "deposit width",
                    None if narrow is None else _OF_WIDTH * narrow,
                    "4/3 of the step to half of the variance, as bias of fourth order has it",
                )
            )
        return causes

    def _temperature(self, weights: Weights) -> NodeTemperature:
        names = tuple(patch.name for patch in self.scene.patches)
        tree = build_octrees(
            replace(self.probed.frame, depth=0), [(None, [])], optical_depth_split=1.0
        )[0]
        view = View.of(self.scene, OpticalCells.of(tree, patches=names))
        return NodeTemperature.of(self.scene, self.probed.node, view.before_background)

    def _traced(self, sources: Sources, frame: Frame) -> Weights:
        tree = build_octrees(frame, [sources], optical_depth_split=self.probed.optical_depth_split)[
            0
        ]
        return trace(tree, self.scene, self.device, self.settings).weights


def difference_K(temperature: NodeTemperature, one: Weights, other: Weights) -> float | None:
    """RMS difference of T_app over the pixels of emissivity above 0.05 in both; None: no pixel.

    Args:
        temperature: of the scene and wavelength.
        one, other: weights (H, W).
    """
    both = (1.0 - one.background > VISIBLE_EMISSIVITY) & (
        1.0 - other.background > VISIBLE_EMISSIVITY
    )
    apart = temperature(one) - temperature(other)
    both &= np.isfinite(apart)
    return float(np.sqrt(np.mean(apart[both] ** 2))) if both.any() else None
