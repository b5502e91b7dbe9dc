"""Light that the last sweeps keep for flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.transport.cells import OpticalCells
from cldit.transport.directions import isotropic
from cldit.transport.groups import lanes
from cldit.transport.thick import RimLight, ThickCells

from .medium import random_tree, sweeper_of


def test_light_kept_in_thick_cells(device: Device) -> None:
    """In a medium that takes nothing out every cell sees what is outside, along every direction: as
    the mean over a layer's steps, whose shares make 1, whichever they are."""
    tree = random_tree(3)
    clear = replace(tree, fields={name: 1e-9 * values for name, values in tree.fields.items()})
    cells = OpticalCells.of(clear)
    thick = ThickCells.of(cells, cells.box(), deeper_than=6e-10)
    assert thick is not None
    flags = {**cells.needs.defines, "BOUNDARY_DISC": 1, "CAMERA_ORTHOGRAPHIC": 1}
    flags |= {"RIM": 1}
    sweeper = sweeper_of(device, cells, flags)
    program = build(device, "sweep.cl", {**flags, **lanes(device)})
    rng = np.random.default_rng(2)
    rays = sweeper.rays(isotropic(14, rng), rng.random((14, 2)))
    light = RimLight.of(
        device,
        thick,
        sweeper.box,
        components=sweeper.components,
        directions=14,
        real=np.float32,
    )
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    mean = np.empty((1, sweeper.components, sweeper.count), np.float32)
    sweeper.moments(program, rays, out=mean, rim=light)
    shape = (thick.rim, 14, sweeper.components)
    kept = download(device, light.buffer, np.empty(shape, np.float32))
    own = thick.own[thick.own >= 0]
    np.testing.assert_allclose(kept[own].sum(axis=2), 1.0, rtol=3e-7)
    assert 0.01 < kept[own, :, 0].mean() < 0.5  # some of it is the background's
    of_each = np.einsum("k,nko->no", rays.directions.weight, kept[own])
    order = np.argsort(own)
    np.testing.assert_allclose(of_each[order].T, mean[0][:, thick.listed], atol=1e-5)
