"""Parcels on the grid of rays against NumPy: places, gathering, deposits, spreading and moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cldit.arrays import Floats
from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.scene.spray import LagrangianSpray, Plume
from cldit.spray.droplet.fluids import Fuel, Gas, fuel_table, gas_table
from cldit.spray.flow.gas import GasFlow
from cldit.spray.flow.injector import Injection, inject
from cldit.spray.flow.measures import sauter_m
from cldit.spray.flow.parcels import SPOT, Cloud
from cldit.spray.flow.rays import RayGrid

from .gas_twin import Twin, drawn, gas_of, get, grid_of

ULP = float(np.finfo(np.float32).eps)
KINDS = ("walls", "ring", "round", "sector")
Vectors = Floats


def fluids() -> tuple[Fuel, Gas]:
    return fuel_table("n-heptane", cache=None), gas_table("nitrogen", cache=None)


def spec_of(**changes: Any) -> LagrangianSpray:
    return LagrangianSpray(
        plumes=(Plume(inclination_deg=0.0, azimuth_deg=0.0),),
        injected_mass_kg=1e-7,
        droplets_per_parcel=2e3,
    ).model_copy(update=changes)


def cloud_of(
    flow: GasFlow, position_m: Floats, velocity_m_s: Floats, **changes: Any
) -> tuple[Cloud, Injection]:
    """Parcels of several sizes at these positions, all born."""
    fuel, carrier = fluids()
    spec, count = spec_of(**changes), len(position_m)
    random = np.random.default_rng(4)
    injection = replace(
        inject(spec, fuel),
        time_s=np.zeros(count),
        hole=np.zeros(count, dtype=np.int64),
        diameter_m=random.uniform(4e-6, 12e-6, count),
        droplets=random.uniform(50.0, 150.0, count),
        position_m=position_m,
        velocity_m_s=velocity_m_s,
    )
    cloud = Cloud(spec, injection, flow, fuel=fuel, carrier=carrier)
    cloud.born = count
    return cloud, injection


def positions(grid: RayGrid, count: int = 300) -> Floats:
    """Within the walls, in all sectors; some near the axis and near the tip."""
    random = np.random.default_rng(3)
    edge = 0.03 if grid.polar[0] > 0 else 0.0  # from the walls: eddies are no part of it
    polar = random.uniform(grid.polar[0] + edge, grid.polar[-1] - 0.03, count)
    polar[:20] = np.clip(1e-3, grid.polar[0] + edge, grid.polar[-1])
    low, high = (-np.pi, np.pi) if grid.symmetry != 1 else (grid.azimuth[0], grid.azimuth[-1])
    edge = 0.0 if grid.ring or grid.symmetry != 1 else 0.03
    azimuth = random.uniform(low + edge, high - edge, count)
    far = random.uniform(0.9 * grid.radius_m[0], 0.99 * grid.radius_m[-1], count)
    local = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    return np.asarray(far[:, None] * np.stack(local, axis=1) @ grid.frame)


def turned(grid: RayGrid, position: Floats) -> tuple[Floats, Floats]:
    """Rotation (N, 3, 3) into the local frame and the sector; and the local positions."""
    local = position @ grid.frame.T
    azimuth = np.arctan2(local[:, 1], local[:, 0])
    turn = np.zeros(len(position))
    if grid.symmetry == 0:
        turn = azimuth
    elif grid.symmetry > 1:
        sector = 2 * np.pi / grid.symmetry
        turn = sector * np.floor(azimuth / sector + 0.5)
    zero, one = np.zeros_like(turn), np.ones_like(turn)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, s, zero], [-s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    out = np.einsum("nij,nj->ni", rotation, local)
    if grid.symmetry > 1:
        flip = np.where(out[:, 1] < 0, -1.0, 1.0)
        rotation[:, 1] *= flip[:, None]
        out[:, 1] *= flip
    return rotation @ grid.frame, out


def weights(grid: RayGrid, position: Floats) -> tuple[Floats, Floats]:
    """Weight of each cell for each position (N, A, P, R), and the cells (N, 3) themselves."""
    _, local = turned(grid, position)
    values = [
        np.arctan2(local[:, 1], local[:, 0]) if grid.symmetry else np.zeros(len(local)),
        np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2]),
        np.linalg.norm(local, axis=1),
    ]
    parts, cells = [], []
    for axis, (x, faces) in enumerate(
        zip(values, (grid.azimuth, grid.polar, grid.radius_m), strict=True)
    ):
        count = len(faces) - 1
        cell = np.clip(np.searchsorted(faces, x, side="right") - 1, 0, count - 1)
        share = np.clip((x - faces[cell]) / np.diff(faces)[cell], 0, 1)
        place = cell + share - 0.5
        part = np.zeros((len(x), count))
        if axis == 0 and grid.ring:
            middle = 0.5 * (faces[1:] + faces[:-1])
            gap = middle[0] - middle[-1] + 2 * np.pi
            closing = (place < 0) | (place > count - 1)
            upper = np.where(place < 0, 1 - (middle[0] - x) / gap, (x - middle[-1]) / gap)
            part[closing, 0] = upper[closing]
            part[closing, -1] += 1 - upper[closing]
            inner = ~closing
        else:
            inner = np.ones(len(x), dtype=bool)
        at = np.clip(place, 0, count - 1)
        low = np.minimum(at.astype(int), max(count - 2, 0))
        rows = np.flatnonzero(inner)
        part[rows, low[rows]] += 1 - (at - low)[rows]
        if count > 1:
            part[rows, low[rows] + 1] += (at - low)[rows]
        parts.append(part)
        cells.append(cell)
    return np.einsum("na,np,nr->napr", *parts), np.stack(cells, axis=1)


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_gas_is_gathered_and_vectors_turn(gas_device: Device, kind: str) -> None:
    """Fluid elements, parcels without evaporation and of tiny droplets, take on the gas's velocity
    at once: the drag of 0.5 um relaxes within 1 us. Weights round by ULP in single precision, times
    cells per radian and per radius: places err by 4e-7 / 0.06 of a cell of the coordinates."""
    flow = gas_of(grid_of(kind), gas_device)
    grid = flow.grid
    position = positions(grid)
    velocity = 5.0 * drawn(flow, 3)
    for plane in range(3):
        flow.write("velocity", velocity[plane], plane)
    cloud, _ = cloud_of(flow, position, np.zeros_like(position), evaporation="none")
    tiny = download(flow.device, cloud.state, np.empty((8, cloud.capacity), np.float32))
    tiny[0] *= 1e-6
    cl.enqueue_copy(flow.device.queue, cloud.state, tiny)
    cloud.step(1e-6)
    cloud.check()
    weight, _ = weights(grid, position)
    rotation, _ = turned(grid, position)
    gas = np.einsum("napr,iapr->ni", weight, velocity)
    if grid.symmetry == 0:
        gas[:, 1] = np.einsum("napr,apr->n", weight, velocity[1])
    wanted = np.einsum("nji,nj->ni", rotation, gas)
    assert np.abs(wanted).max() > 2.0
    found = cloud.read()
    assert len(found.mass_kg) == len(position)
    np.testing.assert_allclose(found.velocity_m_s, wanted, atol=3e-3 * 5.0)


def test_a_deposit_is_in_the_cell_and_kept(gas_device: Device, kind: str) -> None:
    """Momentum of the parcels before they are spread: in fixed point to the float32 of each."""
    flow = gas_of(grid_of(kind), gas_device)
    grid = flow.grid
    position = positions(grid)
    velocity = np.random.default_rng(5).uniform(-50, 50, position.shape)
    cloud, _ = cloud_of(flow, position, velocity, evaporation="none")
    before = cloud.read()
    cloud.step(1e-9)  # they hardly move: cells are those of the start
    after = cloud.read()
    step_given = before.liquid_kg[:, None] * before.velocity_m_s
    step_given -= after.liquid_kg[:, None] * after.velocity_m_s
    rotation, _ = turned(grid, position)
    local = np.einsum("nij,nj->ni", rotation, step_given)
    if grid.symmetry == 0:
        local[:, 1] = 0.0
    amounts = get_amounts(flow)
    total = np.sum(amounts * grid.volume_m3, axis=(1, 2, 3)) * grid.copies
    # Each difference of velocities rounds by ULP of the velocity.
    size = np.sum(np.abs(before.liquid_kg[:, None] * before.velocity_m_s)) * ULP
    assert np.abs(total[2:] - local.sum(axis=0)).max() < 2 * size
    assert np.abs(local).sum() > 20 * size
    assert not amounts[0].any()


def get_amounts(flow: GasFlow) -> Floats:
    return get(flow, "amounts", 5)


def test_what_parcels_give_is_what_they_lose(gas_device: Device, kind: str) -> None:
    """Mass of evaporating parcels, in every cell: by NumPy's cells, then spread by its matrices."""
    flow = gas_of(grid_of(kind), gas_device)
    grid, real = flow.grid, flow.fields.real
    position = positions(grid)
    # Away from faces, where single precision may choose the other cell.
    cloud, _ = cloud_of(flow, position, np.zeros_like(position))
    before = cloud.read()
    cloud.step(5e-6)
    after = cloud.read()
    assert len(after.mass_kg) == len(position)
    lost = before.liquid_kg - after.liquid_kg
    assert (lost > 0).any()
    _, cells = weights(grid, position)
    field = np.zeros(grid.shape)
    np.add.at(field, tuple(cells.T), lost)
    field /= grid.volume_m3 * grid.copies
    twin, volume = Twin(grid), grid.volume_m3
    still = np.zeros(grid.shape)
    polar, radius = grid.middle[1:]
    wide = [np.diff(grid.azimuth)[:, None] * np.sin(polar), np.diff(grid.polar)[None, :]]
    for axis in (1, 0):
        size = np.broadcast_to(wide[axis], grid.shape[:2])
        half = 0.5 * (np.maximum(SPOT**2, size**2 / 6) - size**2 / 12)[:, :, None] * radius**2
        even = 0.5 * twin.conductance(axis) * (half + twin.at(half, axis, -1))
        if grid.shape[axis] > 1:
            field = twin.mixed(field[None], volume, still, even, axis)[0][0]
    dr = np.diff(grid.radius_m)
    half = (dr**2 + 1e-6 * np.minimum(1.0, 10e-3 / radius) ** 2) / 24
    lower = np.concatenate([[0.0], np.minimum(half[1:], half[:-1])])
    field = twin.mixed(field[None], volume, still, twin.conductance(2) * lower, 2)[0][0]
    amounts = get_amounts(flow)[0]
    kept = np.sum(amounts * volume) * grid.copies
    # Masses are float32: half an ULP of each, before and after.
    assert kept == pytest.approx(lost.sum(), abs=ULP * before.liquid_kg.sum())
    # A parcel within 1e-6 of a face may lie on the other side: allow 2 of 300.
    apart = np.sum(np.abs(amounts - field) * volume) * grid.copies
    assert apart < 2 / 300 * 2 * lost.sum() + ULP * before.liquid_kg.sum()
    assert apart < 1e-3 * lost.sum() or real is np.float32


def test_liquid_at_a_wall_is_counted(gas_device: Device, kind: str) -> None:
    """Parcels that leave through the outer wall vanish, with all their mass in the total."""
    flow = gas_of(grid_of(kind), gas_device)
    position = positions(flow.grid, 64)
    position *= (0.95 * flow.grid.radius_m[-1] / np.linalg.norm(position, axis=1))[:, None]
    outward = position / np.linalg.norm(position, axis=1)[:, None]
    velocity = np.where((np.arange(64) % 2 == 0)[:, None], 300.0 * outward, 0.0 * outward)
    cloud, _ = cloud_of(flow, position, velocity, evaporation="none")
    whole = cloud.read().liquid_kg
    cloud.step(1e-5)
    found = cloud.read()
    assert len(found.mass_kg) == 32
    assert cloud.wall_kg == pytest.approx(whole[::2].sum(), rel=4 * ULP)
    assert found.liquid_kg.sum() == pytest.approx(whole[1::2].sum(), rel=4 * ULP)
    cloud.step(1e-5)
    assert cloud.wall_kg == pytest.approx(whole[::2].sum(), rel=4 * ULP)


def test_the_station_counts_what_passes_once(gas_device: Device) -> None:
    """Droplets that cross 15 mm downwards, not those above, below, or already across."""
    grid = replace(grid_of("ring"), frame=np.eye(3)[::-1] * [-1.0, 1.0, -1.0])  # rays downward
    flow = gas_of(grid, gas_device)
    depth = 1e-3 * np.array([14.5, 10.0, 15.6, 14.9])
    position = np.stack([*np.zeros((2, 4)), -depth], axis=1)
    velocity = np.tile([0.0, 0.0, -200.0], (4, 1))
    cloud, injection = cloud_of(flow, position, velocity, evaporation="none")
    assert np.isnan(cloud.station_sauter_m)
    for _ in range(2):
        cloud.step(4e-6)  # 0.8 mm, less by drag
    chosen = [0, 3]
    wanted = sauter_m(injection.droplets[chosen], injection.diameter_m[chosen])
    # Diameters of float32 masses: fits of the density, 3e-4.
    assert cloud.station_sauter_m == pytest.approx(wanted, rel=1e-3)


def test_parcels_fly_freely_to_the_end_of_their_first_step(gas_device: Device) -> None:
    flow = gas_of(grid_of("ring"), gas_device)
    fuel, carrier = fluids()
    spec = spec_of()
    injection = inject(spec, fuel)
    cloud = Cloud(spec, injection, flow, fuel=fuel, carrier=carrier)
    assert len(cloud.read().mass_kg) == 0  # before the injection
    cloud.give_birth(injection.start_s)
    assert cloud.born == 0
    times = np.quantile(injection.time_s, [0.3, 0.3, 1.0]) + 1e-7
    positions_m = []
    for time_s in times:
        cloud.give_birth(float(time_s))
        found = cloud.read()
        count = int(np.searchsorted(injection.time_s, time_s))
        assert cloud.born == count == len(found.mass_kg)
        positions_m.append(found.position_m)
    born = np.searchsorted(times, injection.time_s, side="left")
    late = times[np.minimum(born, 2)] - injection.time_s
    wanted = injection.position_m + late[:, None] * injection.velocity_m_s
    # Times of 1e-3 s in single precision: 6e-11 s at 200 m/s are 12 nm.
    np.testing.assert_allclose(positions_m[-1], wanted, atol=4 * ULP * 1e-3 * 300.0 + 1e-9)


@pytest.mark.parametrize("count", [0, 1])
def test_no_parcel_and_one(gas_device: Device, count: int) -> None:
    flow = gas_of(grid_of("round"), gas_device)
    position = positions(flow.grid)[:count]
    cloud, _ = cloud_of(flow, position, 10.0 * position)
    cloud.step(1e-6)
    flow.step(1e-6)
    flow.check()
    assert len(cloud.read().mass_kg) == count
    assert (flow.fuel_kg > 0) == (count > 0)
    assert cloud.wall_kg == 0.0


def test_two_runs_have_the_same_bits(gas_device: Device) -> None:
    """Sums are in fixed point, so the order of parcels cannot matter."""
    results = []
    for _ in range(2):
        flow = gas_of(grid_of("sector"), gas_device)
        position = positions(flow.grid, 1500)
        cloud, _ = cloud_of(flow, position, 3000.0 * position)
        for _ in range(3):
            cloud.step(2e-6)
            flow.step(2e-6, steps=2)
        found = cloud.read()
        results.append([flow.read("temperature"), flow.read("fuel"), found.position_m])
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)
