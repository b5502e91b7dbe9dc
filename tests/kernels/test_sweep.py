"""The sweep kernel as a whole, against the NumPy reference of the same physics."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from cldit.gpu.device import Device
from cldit.scene.vessel import Patch
from cldit.transport.angular_moments import MOMENTS, discrete_to_moment
from cldit.transport.boundary import NONE, boundary_seen, patch_rows, shifted
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.blurred_boundary import SIDE, upload_blurred
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.gmres import order_0
from cldit.transport.discrete_ordinates.quadrature import Ordinates, isotropic
from cldit.transport.discrete_ordinates.sweep import Sweeper

from .medium import DISC, ENCLOSURE, random_tree, source_planes, sweep_program, sweeper_of
from .reference import sweep

WINDOWS = (
    Patch(name="window", centre_m=(-0.1, 0, 0), facing="+x", radius_m=0.05, temperature_K=295),
    Patch(
        name="plate",
        centre_m=(0, 0.02, 0.09),
        facing=(0.1, 0.2, -1.0),
        size_m=(0.08, 0.2),
        temperature_K=400,
    ),
)


def next_order(
    sweeper: Sweeper,
    cells: OpticalCells,
    source: NDArray[np.floating],
    directions: Ordinates,
    starts: NDArray[np.float64],
    patches: NDArray[np.float64] = NONE,
) -> NDArray[np.float64]:
    """Source (C, N) after a further scattering of the light of `source`, by the NumPy twin."""
    box = sweeper.box
    planes = source_planes(cells)
    planes[:, cells.address] = source
    dense = np.stack([cells.dense(box, plane) for plane in planes])
    light = dense.copy()
    for unit, weight, start in zip(directions.unit, directions.weight, starts, strict=True):
        light += sweep(
            cells.dense(box, cells.depth),
            dense,
            back=unit,
            weight=float(weight),
            start=start,
            centre=DISC[:3] - box.low,
            radius=4.0,
            patches=shifted(patches, -np.array(box.low, float)),
        )[0]
    mean = light.reshape(len(dense), -1)[:, cells.place(box, cells.address)]
    return np.asarray(cells.albedo * mean + sweeper.thermal)


@pytest.mark.parametrize(
    ("float64", "vector", "windows"), [(False, 8, ()), (False, 1, WINDOWS), (True, 8, WINDOWS)]
)
def test_sweep_against_numpy(
    device: Device, vector: int, float64: bool, windows: tuple[Patch, ...]
) -> None:
    """Directions of all three main axes and both senses; a cell sums some 16 rays of order 1."""
    if float64 and not device.info.float64:
        pytest.skip("the device has no double precision")
    tree = random_tree(3)
    cells = OpticalCells.of(tree, patches=tuple(patch.name for patch in windows))
    patches = patch_rows(windows, tree.frame)
    double = {"USE_FLOAT64": 1} if float64 else {}
    sweeper = sweeper_of(device, cells, {**double, "SIMD_WIDTH": vector}, patches=patches)
    rng = np.random.default_rng(5)
    directions = isotropic(12, rng)
    starts = rng.random((12, 2))
    guess = order_0(sweeper, cells.albedo)
    sweeper.set_source(guess, shining=True)
    sweeper.sweep(sweeper.rays(directions, starts), shining=True)
    got = sweeper.read(sweeper.next_order())
    expected = next_order(sweeper, cells, guess, directions, starts, patches)
    if windows:
        assert np.all(expected[2:4].max(axis=1) > 0.01)  # both are seen
    # Twelve rays through at most 16 cells, each a few roundings; a ray that crosses a cell boundary
    # within rounding (none at this seed) would differ by far more.
    np.testing.assert_allclose(got, expected, atol=1e-13 if float64 else 1e-6)


def test_rays_that_change_rows_at_the_ends_of_layers(device: Device) -> None:
    """Along the cube's diagonals, from corner to corner of cells (tolerance: as above)."""
    cells = OpticalCells.of(random_tree(3))
    sweeper = sweeper_of(device, cells)
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) / 3**0.5
    directions, starts = Ordinates(corners, np.full(8, 1 / 8)), np.zeros((8, 2))
    guess = order_0(sweeper, cells.albedo)
    sweeper.set_source(guess, shining=True)
    sweeper.sweep(sweeper.rays(directions, starts), shining=True)
    expected = next_order(sweeper, cells, guess, directions, starts)
    np.testing.assert_allclose(sweeper.read(sweeper.next_order()), expected, atol=1e-6)


def moments(
    device: Device, cells: OpticalCells, flags: dict[str, Any], *, vector: int
) -> dict[str, NDArray[np.floating]]:
    """Angular moments (9, C, N) of the radiance from a random source along twelve ordinates.

    "got" is the kernel's, "expected" the NumPy twin's. "given" is the source (1 or 9, C, N),
    "changes" its gradient (3, C, M). With SPATIAL_MOMENTS, "more" is the radiance's gradient less
    the source's, and "expected more" the twin's."""
    defines = {**flags, "ANGULAR_MOMENTS": 1, "SIMD_WIDTH": vector}
    program = sweep_program(device, cells, defines)
    rng = np.random.default_rng(5)
    linear_cells = rng.random(len(cells.address)) < 0.3 if "SPATIAL_MOMENTS" in flags else None
    sweeper = sweeper_of(device, cells, defines, linear_cells=linear_cells)
    directions, starts = isotropic(12, rng), rng.random((12, 2))
    moments = MOMENTS if "MOMENT_SOURCE" in flags else 1
    given = rng.uniform(-0.3, 1.0, (moments, sweeper.components, sweeper.count))
    changes = rng.uniform(-0.5, 0.5, (3, sweeper.components, len(sweeper.linear_cells)))
    sweeper.set_source(
        given.reshape(-1, sweeper.count),
        shining=True,
        gradient=None if linear_cells is None else changes,
    )
    if sweeper.gradients is not None:
        changes = sweeper.gradients(given[0])
    out, room = sweeper.unset_light(MOMENTS), sweeper.room(MOMENTS)
    found = sweeper.moments(program, sweeper.rays(directions, starts), out=out, room=room)
    got = sweeper.read(out, MOMENTS).reshape(MOMENTS, sweeper.components, -1)
    more = None if found is None else sweeper.read_gradient(found)

    box = sweeper.box
    planes = np.zeros((MOMENTS + 3, sweeper.components, len(cells.depth)))
    planes[0] = source_planes(cells)
    planes[:moments, :, cells.address] = given
    planes[MOMENTS:, :, cells.address[sweeper.linear_cells]] = changes
    dense = np.array([[cells.dense(box, plane) for plane in some] for some in planes])
    expected = np.zeros_like(dense[:MOMENTS])
    across = np.zeros_like(dense[:3])
    for unit, weight, start in zip(directions.unit, directions.weight, starts, strict=True):
        i_minus_s = sweep(
            cells.dense(box, cells.depth),
            dense[0],
            back=unit,
            weight=float(weight),
            start=start,
            centre=DISC[:3] - box.low,
            radius=4.0,
            slope=dense[1:MOMENTS],
            gradient=dense[MOMENTS:],
        )
        expected += np.multiply.outer(
            [1.0, *discrete_to_moment(unit[None])[:, 0]], weight * dense[0] + i_minus_s[0]
        )
        across += i_minus_s[1:]
    total = directions.weight.sum()
    expected[1:] -= np.multiply.outer(
        discrete_to_moment(directions.unit) @ directions.weight, expected[0]
    )
    place = cells.place(box, cells.address)
    both = {
        "got": got,
        "expected": expected.reshape(MOMENTS, len(dense[0]), -1)[:, :, place],
        "given": given,
        "changes": changes,
    }
    if more is not None:
        here = place[sweeper.linear_cells]
        both["more"] = more
        both["expected more"] = 12 / total * across.reshape(3, len(dense[0]), -1)[:, :, here]
    return both


def test_moments_against_numpy(device: Device) -> None:
    """Sources with angular moments, and the angular moments of the radiance."""
    cells = OpticalCells.of(random_tree(3))
    light = moments(device, cells, {"MOMENT_SOURCE": 1}, vector=8)
    # As above: a ray's few roundings in each of at most 16 cells.
    np.testing.assert_allclose(light["got"], light["expected"], atol=2e-6)


@pytest.mark.parametrize(
    ("sloped", "vector"), [(False, 8), pytest.param(True, 1, marks=pytest.mark.slow)]
)
def test_gradients_against_numpy(device: Device, vector: int, sloped: bool) -> None:
    """Linear sources, with and without angular moments."""
    tree = random_tree(3)
    fields = {name: 8 * values for name, values in tree.fields.items()}
    every = OpticalCells.of(tree)
    clear = every.positions(every.address)[:, 1] % 2 == 0  # whole packets of cells, of either order
    fields["droplet_scattering"][every.address[clear]] = 0.0
    fields["droplet_absorption"] = fields["droplet_absorption"] / 1e3
    fields["vapour_absorption"] = fields["vapour_absorption"] / 1e5
    cells = OpticalCells.of(replace(tree, fields=fields))
    flags: dict[str, Any] = {"LINEAR_SOURCE": 1, **({"MOMENT_SOURCE": 1} if sloped else {})}
    light = moments(device, cells, flags, vector=vector)
    assert np.mean(np.any(light["changes"] != 0, axis=(0, 1))) > 0.2  # the test is of something
    # A few roundings in each of at most 16 cells; `rising` is the difference of numbers next to 1.
    np.testing.assert_allclose(light["got"], light["expected"], atol=4e-6)


@pytest.mark.parametrize("deeper", [1e-3, 1.0, 30.0])
def test_light_across_cells_against_numpy(device: Device, deeper: float) -> None:
    """Spatial moments of I - S in thin and thick cells with linear sources; the twin integrates
    along every ray."""
    tree = random_tree(3)
    cells = OpticalCells.of(
        replace(tree, fields={name: deeper * values for name, values in tree.fields.items()})
    )
    light = moments(
        device, cells, {"LINEAR_SOURCE": 1, "MOMENT_SOURCE": 1, "SPATIAL_MOMENTS": 1}, vector=8
    )
    np.testing.assert_allclose(light["got"], light["expected"], atol=4e-6)
    # Twelve times as much as the means; sources of 3 in all, where they have a slope.
    np.testing.assert_allclose(light["more"], light["expected more"], atol=5e-5)


def test_light_to_the_camera_changes_as_the_light_does(device: Device) -> None:
    """And has its mean, but with VIEW_TRANSMISSION in cells that hide some of it from the
    camera."""
    tree = random_tree(3)
    cells = OpticalCells.of(tree)
    fields = {name: 1e-9 * values for name, values in tree.fields.items()}
    clear = OpticalCells.of(replace(tree, fields=fields))
    linear = {"LINEAR_SOURCE": 1}
    defines = {**linear, "SPATIAL_MOMENTS": 1}
    program = sweep_program(device, cells, defines)
    rng = np.random.default_rng(5)
    linear_cells = rng.random(len(cells.address)) < 0.3
    sweeper = sweeper_of(device, cells, defines, linear_cells=linear_cells)
    given = rng.uniform(0.0, 1.0, (sweeper.components, sweeper.count))
    changes = rng.uniform(-0.5, 0.5, (3, sweeper.components, len(sweeper.linear_cells)))
    sweeper.set_source(given, shining=True, gradient=changes)
    rays = sweeper.rays(isotropic(12, rng), rng.random((12, 2)))
    out = sweeper.unset_light(1)
    more = sweeper.read_gradient(sweeper.moments(program, rays, out=out))
    light = sweeper.read(out)[None]
    flags = {"CAMERA_SWEEP": 1}
    towards = sweep_program(device, cells, {**defines, **flags})
    seen_there = sweep_program(device, cells, {**linear, **flags, "VIEW_TRANSMISSION": 1})
    nowhere: dict[str, Any] = {"phase": np.zeros(1), "place": np.zeros(4)}
    for seen in (clear, cells):
        camera = CameraSweep.of(sweeper.boxes, towards, seen, **nowhere)
        mean, discrete_to_moment = sweeper.view_weighted_mean(camera, rays)
        np.testing.assert_allclose(mean, light[0], rtol=0, atol=2e-6)  # a few roundings of 12 rays
        assert discrete_to_moment is not None
        np.testing.assert_allclose(discrete_to_moment, more, atol=5e-5)  # twelve times as much
        camera = CameraSweep.of(
            sweeper.boxes, seen_there, seen, phase=np.zeros(1), place=np.zeros(4)
        )
        mean, _ = sweeper.view_weighted_mean(camera, rays)
        assert np.allclose(mean, light[0], rtol=0, atol=2e-6) == (seen is clear)


@pytest.mark.parametrize(
    ("windows", "vector"), [pytest.param((), 1, marks=pytest.mark.slow), (WINDOWS, 8)]
)
def test_blurred_boundary_against_numpy(
    device: Device, vector: int, windows: tuple[Patch, ...]
) -> None:
    """The sum of two sweeps of the twin: blurred boundary and sources by the depths of the sweep,
    and the excess of the boundary, without sources, by those of the medium as it is."""
    tree = random_tree(3)
    names = tuple(patch.name for patch in windows)
    whole = OpticalCells.of(tree, patches=names)
    cells = OpticalCells.of(tree, patches=names, scattered=0.4).in_units_of(whole)
    patches = patch_rows(windows, tree.frame)
    defines = {"SIMD_WIDTH": vector, "LINEAR_SOURCE": 1, "SPATIAL_MOMENTS": 1,
               "CAMERA_SWEEP": 1, "BLURRED_BOUNDARY": SIDE}  # fmt: skip
    program = sweep_program(device, cells, defines)
    rng = np.random.default_rng(5)
    linear_cells = rng.random(len(cells.address)) < 0.3
    sweeper = sweeper_of(device, cells, defines, patches=patches, linear_cells=linear_cells)
    given = rng.uniform(0.0, 1.0, (sweeper.components, sweeper.count))
    changes = rng.uniform(-0.5, 0.5, (3, sweeper.components, len(sweeper.linear_cells)))
    sweeper.set_source(given, shining=True, gradient=changes)
    directions, starts = isotropic(12, rng), rng.random((12, 2))
    maps = rng.uniform(-0.1, 1.1, (12, 1 + len(windows), SIDE, SIDE))
    frames = rng.uniform(-0.3, 0.3, (12, 2, 4))
    frames[..., 3] += 2.0
    blurred = upload_blurred(device, maps, frames, np.float32)
    camera = CameraSweep.of(sweeper.boxes, program, whole, phase=np.zeros(1), place=np.zeros(4))
    got, more = sweeper.view_weighted_mean(
        camera, sweeper.rays(directions, starts), blurred=blurred
    )

    box = sweeper.box
    planes = np.zeros((4, sweeper.components, len(cells.depth)))
    planes[0] = source_planes(cells)
    planes[0][:, cells.address] = given
    planes[1:, :, cells.address[sweeper.linear_cells]] = changes
    dense = np.array([[cells.dense(box, plane) for plane in some] for some in planes])

    def inflow(number: int, excess: bool, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """The blurred boundary (C, N) along an ordinate, or what the boundary has beyond it."""
        lines = np.broadcast_to(directions.unit[number], point.shape)
        inside = shifted(patches, -np.array(box.low, float))
        seen = boundary_seen(point, lines, centre=DISC[:3] - box.low, radius=4.0, patches=inside)
        sharp = (np.arange(sweeper.components)[:, None] == seen).astype(float)
        frame = frames[number]
        places = np.clip(frame[:, :3] @ point.T + frame[:, 3:], 0, SIDE - 1)[::-1]
        found = np.zeros_like(sharp)
        for c, map_ in zip((0, *range(2, 2 + len(windows))), maps[number], strict=True):
            found[c] = map_coordinates(map_, places, order=1)
        found[1] = 1 - found.sum(axis=0)
        return np.asarray(sharp - found if excess else found)

    parts: NDArray[np.float64] = np.zeros((4, *dense[0].shape))
    for number, (unit, weight, start) in enumerate(
        zip(directions.unit, directions.weight, starts, strict=True)
    ):
        common: dict[str, Any] = {
            "back": unit,
            "weight": float(weight),
            "start": start,
            "centre": DISC[:3] - box.low,
            "radius": 4.0,
        }
        parts = parts + sweep(
            cells.dense(box, cells.depth),
            dense[0],
            gradient=dense[1:],
            inflow=partial(inflow, number, False),
            **common,
        )
        parts = parts + sweep(
            whole.dense(box, whole.depth),
            0 * dense[0],
            gradient=0 * dense[1:],
            inflow=partial(inflow, number, True),
            **common,
        )
    place = cells.place(box, cells.address)
    total = directions.weight.sum()
    flat = (dense[0] + parts[0] / total).reshape(sweeper.components, -1)
    # As above: a ray's few roundings in each of at most 16 cells, of two rays.
    np.testing.assert_allclose(got, flat[:, place], atol=4e-6)
    assert more is not None
    steep = 12 / total * parts[1:].reshape(3, sweeper.components, -1)
    np.testing.assert_allclose(more, steep[:, :, place[sweeper.linear_cells]], atol=5e-5)


def test_light_in_opaque_cells_changes_as_their_source(device: Device) -> None:
    """It is that source, but for a skin of 1 / depth of a cell, twelve times of which counts, from
    two sides. The depth of a cell is limited to 2^17 over the cells along the cube."""
    tree = random_tree(3)
    fields = {name: 1e6 * values for name, values in tree.fields.items()}
    cells = OpticalCells.of(replace(tree, fields=fields))
    light = moments(device, cells, {"LINEAR_SOURCE": 1, "SPATIAL_MOMENTS": 1}, vector=8)
    assert np.abs(light["changes"]).max() > 0.3
    skin = tree.frame.cells / 2**17
    assert np.abs(light["more"]).max() < 2 * 12 * skin


def test_sweep_of_one_row_is_exact(device: Device) -> None:
    """Along an axis the sweep is the exact solution: Beer-Lambert through the cells."""
    tree = random_tree(4, scattering=1e-9)
    cells = OpticalCells.of(tree)
    sweeper = sweeper_of(device, cells, disc=ENCLOSURE)
    along = Ordinates(unit=np.array([[0.0, 1.0, 0.0]]), weight=np.ones(1))
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    sweeper.sweep(sweeper.rays(along, np.zeros((1, 2))), shining=True)
    mean = sweeper.read(sweeper.next_order())[0] - sweeper.thermal[0]
    depth = cells.dense(sweeper.box, cells.depth)
    beyond = np.cumsum(depth[:, ::-1], axis=1)[:, ::-1] - depth
    expected = np.exp(-beyond) * np.where(depth > 0, -np.expm1(-depth) / np.maximum(depth, 1e-9), 1)
    place = cells.place(sweeper.box, cells.address)
    np.testing.assert_allclose(mean / cells.albedo, expected.reshape(-1)[place], rtol=2e-6)


def test_sweeps_repeat_to_the_last_bit(device: Device) -> None:
    """Work-groups that add to the same cells never run at the same time: many slanted directions,
    over and over, always give the same sums."""
    tree = random_tree(6, cells=32)
    cells = OpticalCells.of(tree)
    sweeper = sweeper_of(device, cells)
    rng = np.random.default_rng(2)
    directions, starts = isotropic(24, rng), rng.random((24, 2))
    discrete_to_moment = []
    for _ in range(6):
        sweeper.set_source(order_0(sweeper, cells.albedo), shining=True)
        sweeper.sweep(sweeper.rays(directions, starts), shining=True)
        discrete_to_moment.append(sweeper.read(sweeper.next_order()))
    for other in discrete_to_moment[1:]:
        np.testing.assert_array_equal(other, discrete_to_moment[0])
