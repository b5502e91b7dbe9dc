"""The scene that is solved, and the parts that different resolutions share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cldit.accuracy.node_traces import node_settings
from cldit.accuracy.resolution import Resolution, cells_are_free, too_fine, too_many
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError
from cldit.gpu.device import Device
from cldit.medium.resolution import counted
from cldit.prepare.medium import Medium, Prepared, prepare
from cldit.prepare.preview import visible_emissivities
from cldit.prepare.stages import Stages
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray
from cldit.spray.result import Spray
from cldit.transport.trace import TraceSettings

# Steps to the finest lattice that suits a cone, or fits the memory: cells that differ by less have
# nearly the same error.
_COARSER = 1.15


@dataclass
class Problem:
    """A scene with its device; keeps what a change of resolution leaves as it is."""

    scene: Scene
    device: Device
    stages: Stages
    cache: Path
    spray: Spray | None
    _prepared: tuple[tuple[Any, ...], Prepared] | None = None
    _tracer: tuple[tuple[Any, ...], VariantTracer] | None = None

    def prepared(self, resolution: Resolution) -> tuple[Resolution, Prepared]:
        """Spray and optics; kept if the resolution does not change them.

        A lattice that is too fine for the cone, or the memory, becomes as fine as it can be.
        """
        given_m = self.scene.spray.lattice_m if isinstance(self.scene.spray, ConeSpray) else 0.0
        while True:
            if self._prepared is not None:
                key, prepared = self._prepared
                if key != resolution.prepared_key:  # else it is kept even if memory is less now
                    resolution = clamp_to_memory(resolution, prepared)
                if key == resolution.prepared_key:
                    return resolution, prepared
            try:
                prepared = prepare(
                    self.scene,
                    self.device,
                    self.stages,
                    self.cache,
                    self.spray,
                    spec=resolution.spray(self.scene),
                    cube_m=resolution.cube_m,
                    spectral_K=resolution.spectral_K,
                )
            except SprayError:
                tried_m = resolution.spacing_m
                if tried_m is None or tried_m == given_m:
                    raise
                if tried_m > given_m:  # a short plume: the lattice to learn from is too coarse
                    resolution = replace(resolution, spacing_m=given_m)
                    continue
                coarser_m = min(_COARSER * tried_m, given_m)
                limited = "gas grid"
                if resolution.cube_m is not None:
                    resolution, limited = resolution.on_lattice(coarser_m), "cells"
                resolution = replace(resolution, spacing_m=coarser_m)
                resolution = resolution.limited(limited, too_fine(coarser_m))
                continue
            self._prepared = resolution.prepared_key, prepared
            return resolution, prepared

    def settings(self, resolution: Resolution, prepared: Prepared) -> list[TraceSettings]:
        """Settings of each wavelength's trace; some pixels of one are traced by more rays."""
        properties = prepared.properties
        settings = node_settings(
            self.scene,
            properties.chosen.quadrature,
            properties.phases,
            tolerance_K=resolution.ordinates_K,
            more_ordinates=resolution.more_ordinates,
        )
        if self.scene.transport.audit:
            visible = visible_emissivities(prepared)
            settings = [
                replace(setting, visible=emissivity)
                for setting, emissivity in zip(settings, visible, strict=True)
            ]
            number = prepared.number
            settings[number] = replace(settings[number], subpixels=True, rays_K=resolution.pixels_K)
        return settings

    def tracer(self, resolution: Resolution) -> tuple[Resolution, VariantTracer]:
        """Traces variants of the medium; kept if the resolution changes its cells alone."""
        resolution, prepared = self.prepared(resolution)
        ordinates = (resolution.ordinates_K, resolution.more_ordinates)
        key = (*ordinates, resolution.pixels_K, *resolution.prepared_key)
        if self._tracer is None or self._tracer[0] != key:
            previous = None if self._tracer is None else self._tracer[1]
            node_setting = self.settings(resolution, prepared)[prepared.number]
            alike = (*ordinates, resolution.spectral_K, resolution.size_classes)
            self._tracer = key, VariantTracer.of(prepared, node_setting, alike, previous)
        return resolution, self._tracer[1]

    def medium(self, resolution: Resolution) -> tuple[Resolution, Prepared, Medium]:
        """Octrees; on larger cells where those of the resolution do not fit the memory."""
        while True:
            resolution, prepared = self.prepared(resolution)
            on_lattice = resolution.cube_m is not None  # cells and lattice are made together
            depth = None if on_lattice else resolution.depth
            try:
                return resolution, prepared, prepared.grown(depth)
            except MediumError:
                depth = resolution.depth
                if not depth or not cells_are_free(self.scene):
                    raise
                if not on_lattice:
                    reason = too_many(prepared.frame.at(depth).cell_m)
                    resolution = resolution.at_depth(depth - 1).limited("cells", reason)
                    continue
                assert resolution.spacing_m is not None
                reason = resolution.limits.get("cells") or too_many(resolution.spacing_m)
                coarser = resolution.on_lattice(_COARSER * resolution.spacing_m)
                resolution = coarser.limited("cells", reason)

    def hardly_finer(self, finer: Resolution, than: Resolution) -> str:
        """Reason why the cells of a finer resolution are not worth a trace; empty: they are."""
        assert self._prepared is not None
        prepared = self._prepared[1]
        if finer.depth != than.depth and finer.cube_m is None and finer.depth is not None:
            frame = prepared.frame.at(finer.depth)
            held = counted(frame, prepared.sources, self.device).memory_cells <= prepared.limit
            return "" if held else too_many(frame.cell_m)
        possible = clamp_to_memory(finer, prepared)
        if possible is finer or possible.spacing_m is None or than.spacing_m is None:
            return ""
        hardly = _COARSER * possible.spacing_m >= than.spacing_m
        return possible.limits.get("cells", "") if hardly else ""


def clamp_to_memory(resolution: Resolution, prepared: Prepared) -> Resolution:
    """The resolution with a lattice whose parcels fit the memory, by those that were made."""
    spacing_m, wavelengths = resolution.spacing_m, len(prepared.properties.sources)
    if resolution.cube_m is None or spacing_m is None:
        return resolution
    finest_m = prepared.finest_lattice_m(
        wavelengths=wavelengths, size_classes=resolution.size_classes
    )
    if spacing_m >= finest_m:
        return resolution
    return resolution.on_lattice(finest_m).limited("cells", too_many(spacing_m))
