"""Radiance that the final sweeps store for path segments of the final gather."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning

from .medium import ENCLOSURE, random_tree, sweep_program, sweeper_of


def test_radiance_on_interfaces(device: Device) -> None:
    """In a transparent medium every interface has the boundary's radiance along every ordinate that
    enters the region there."""
    tree = random_tree(3)
    clear = replace(tree, fields={name: 1e-9 * values for name, values in tree.fields.items()})
    cells = OpticalCells.of(clear)
    thick = ThickRegion.of(cells, cells.box(), deeper_than=6e-10, tuning=Tuning())
    assert thick is not None
    flags = {"INTERFACE_RADIANCE": 1}
    sweeper = sweeper_of(device, cells, flags)
    program = sweep_program(device, cells, flags)
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
    mean = np.zeros((1, sweeper.components, sweeper.count), np.float32)
    sweeper.moments(program, rays, out=sweeper.listed(mean), interfaces=light)
    shape = (thick.interfaces, 14, sweeper.components)
    stored = download(device, light.buffer, np.empty(shape, np.float32))
    entering = []
    for ordinate, unit in enumerate(rays.directions.unit):
        for axis, upwards in enumerate(unit > 0):  # to where light comes from
            number = thick.faces[:, 2 * axis + int(upwards)]
            entering.append(stored[number[number >= 0], ordinate])
    found = np.concatenate(entering)
    assert len(found) > 14 * 3 * 20
    np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=3e-7)
    assert 0.01 < found[:, 0].mean() < 0.5  # some of it is the background's


def test_radiance_on_interfaces_along_an_axis(device: Device) -> None:
    """By Beer and Lambert, through cold cells."""
    cells = OpticalCells.of(random_tree(4, scattering=1e-9))
    box = cells.box()
    deeper = float(np.median(cells.depth[cells.address]))
    thick = ThickRegion.of(cells, box, deeper_than=deeper, tuning=Tuning())
    assert thick is not None
    flags = {"INTERFACE_RADIANCE": 1}
    sweeper = sweeper_of(device, cells, flags, disc=ENCLOSURE)
    program = sweep_program(device, cells, flags)
    along = Ordinates(unit=np.array([[0.0, 1.0, 0.0]]), weight=np.ones(1))
    rays = sweeper.rays(along, np.zeros((1, 2)))
    light = InterfaceRadiance.of(
        device, thick, box, components=sweeper.components, directions=1, real=np.float32
    )
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    mean = np.zeros((1, sweeper.components, sweeper.count), np.float32)
    sweeper.moments(program, rays, out=sweeper.listed(mean), interfaces=light)
    stored = download(
        device, light.buffer, np.empty((thick.interfaces, sweeper.components), np.float32)
    )
    depth = cells.dense(box, cells.depth)
    beyond = np.cumsum(depth[:, ::-1], axis=1)[:, ::-1] - depth
    number = thick.faces[:, 3]  # the upper face along y
    x, y, z = thick.at[number >= 0].T
    assert len(x) > 20
    np.testing.assert_allclose(stored[number[number >= 0], 0], np.exp(-beyond[z, y, x]), rtol=2e-6)
