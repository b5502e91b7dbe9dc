"""Radiance that the final sweeps store for path segments of the final gather."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.cell_packets import simd_defines
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning

from .medium import random_tree, sweeper_of


def test_radiance_in_thick_cells(device: Device) -> None:
    """In a transparent medium every cell has the boundary's radiance along every ordinate: the mean
    over a layer's segments, whose shares sum to 1."""
    tree = random_tree(3)
    clear = replace(tree, fields={name: 1e-9 * values for name, values in tree.fields.items()})
    cells = OpticalCells.of(clear)
    thick = ThickRegion.of(cells, cells.box(), deeper_than=6e-10, tuning=Tuning())
    assert thick is not None
    flags = {**cells.needs.defines, "BOUNDARY_DISC": 1, "CAMERA_ORTHOGRAPHIC": 1}
    flags |= {"INTERFACE_RADIANCE": 1}
    sweeper = sweeper_of(device, cells, flags)
    program = build(device, "sweep.cl", {**flags, **simd_defines(device)})
    rng = np.random.default_rng(2)
    rays = sweeper.rays(isotropic(14, rng), rng.random((14, 2)))
    light = InterfaceRadiance.of(
        device,
        thick,
        sweeper.box,
        components=sweeper.components,
        directions=14,
        real=np.float32,
    )
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    mean = np.empty((1, sweeper.components, sweeper.count), np.float32)
    sweeper.moments(program, rays, out=mean, interfaces=light)
    shape = (thick.interfaces, 14, sweeper.components)
    stored = download(device, light.buffer, np.empty(shape, np.float32))
    own = thick.own[thick.own >= 0]
    np.testing.assert_allclose(stored[own].sum(axis=2), 1.0, rtol=3e-7)
    assert 0.01 < stored[own, :, 0].mean() < 0.5  # some of it is the background's
    of_each = np.einsum("k,nko->no", rays.directions.weight, stored[own])
    order = np.argsort(own)
    np.testing.assert_allclose(of_each[order].T, mean[0][:, thick.listed], atol=1e-5)


def test_light_in_a_cell_is_the_mean_of_what_comes_in_and_leaves(device: Device) -> None:
    """Along an axis by Beer and Lambert, through cold cells."""
    cells = OpticalCells.of(random_tree(4, scattering=1e-9))
    box = cells.box()
    deeper = float(np.median(cells.depth[cells.address]))
    thick = ThickRegion.of(cells, box, deeper_than=deeper, tuning=Tuning())
    assert thick is not None
    flags = {**cells.needs.defines, "BOUNDARY_ENCLOSURE": 1, "INTERFACE_RADIANCE": 1}
    sweeper = sweeper_of(device, cells, flags)
    program = build(device, "sweep.cl", {**flags, **simd_defines(device)})
    along = Ordinates(unit=np.array([[0.0, 1.0, 0.0]]), weight=np.ones(1))
    rays = sweeper.rays(along, np.zeros((1, 2)))
    light = InterfaceRadiance.of(
        device, thick, box, components=sweeper.components, directions=1, real=np.float32
    )
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    mean = np.empty((1, sweeper.components, sweeper.count), np.float32)
    sweeper.moments(program, rays, out=mean, interfaces=light)
    stored = download(
        device, light.buffer, np.empty((thick.interfaces, sweeper.components), np.float32)
    )
    depth = cells.dense(box, cells.depth)
    beyond = np.cumsum(depth[:, ::-1], axis=1)[:, ::-1] - depth
    expected = np.exp(-beyond) * (1 + np.exp(-depth)) / 2
    there = cells.place(box, cells.address[thick.listed])
    own = np.sort(thick.own[thick.own >= 0])  # as the thick cells are listed
    np.testing.assert_allclose(stored[own, 0], expected.reshape(-1)[there], rtol=2e-6)
