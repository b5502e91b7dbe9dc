"""The sweep and the image kernels as wholes, against the NumPy reference of the same physics."""

from __future__ import annotations

import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.gpu.buffers import download
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.medium.frame import Frame
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.scene import parse_scene
from cldit.scene.vessel import Patch
from cldit.transport.cells import OpticalCells
from cldit.transport.directions import Directions, isotropic
from cldit.transport.filled import Filled
from cldit.transport.moments import MOMENTS, found
from cldit.transport.patches import patch_rows, shifted
from cldit.transport.phase import henyey_greenstein
from cldit.transport.reference import march, sweep
from cldit.transport.solve import first_guess
from cldit.transport.sweep import Sweeper, sweep_defines
from cldit.transport.thick import RimLight, ThickCells
from cldit.transport.trace import Settings, trace

EDGE_M = 0.16
DISC = np.array([8.0, 17.0, 9.0, 16.0])


def random_tree(seed: int, *, cells: int = 16, scattering: float = 1.0) -> Octree:
    """A block of random coefficients in part of the cube, with empty cells among them."""
    rng = np.random.default_rng(seed)
    frame = Frame(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=cells.bit_length() - 1)
    filled = rng.random((cells // 2, cells - 3, cells // 2)) < 0.7
    place = np.argwhere(filled) + np.array([3, 1, 5])
    lower = -EDGE_M / 2 + place * frame.cell_m
    values = rng.uniform(0.0, 0.6, (5, len(place))) / frame.cell_m
    return build_octree(
        frame,
        None,
        [
            CellSource(
                lower_m=lower,
                upper_m=lower + frame.cell_m,
                vapour_absorption=values[0],
                vapour_emission=values[0] * rng.random(len(place)),
                droplet_absorption=values[2],
                droplet_scattering=scattering * values[3],
                droplet_emission=values[2] * rng.random(len(place)),
            )
        ],
        optical_depth_split=1e-5,
    )


WINDOWS = (
    Patch(name="window", centre_m=(-0.1, 0, 0), facing="+x", radius_m=0.05, temperature_K=295),
    Patch(
        name="plate",
        shape="rectangle",
        centre_m=(0, 0.02, 0.09),
        facing=(0.1, 0.2, -1.0),
        size_m=(0.08, 0.2),
        temperature_K=400,
    ),
)


def source_planes(cells: OpticalCells) -> NDArray[np.float64]:
    """Thermal source (C, P) of all stored cells; what comes from outside begins in none."""
    outside = np.zeros((cells.needs.boundaries, len(cells.depth)))
    return np.concatenate([outside, cells.thermal_planes(np.float64)])


def sweeper_of(device: Device, cells: OpticalCells, defines: dict[str, Any]) -> Sweeper:
    """The tree's box on the device, compiled with these beside what the cells need."""
    common = {**cells.needs.defines, **defines}
    return Sweeper(
        device,
        cells,
        build(device, "sweep.cl", {**common, **sweep_defines(device)}),
        build(device, "iterate.cl", common),
        disc=DISC,
    )


@pytest.mark.parametrize("windows", [(), WINDOWS])
@pytest.mark.parametrize("vector", [1, 8])
@pytest.mark.parametrize("float64", [False, True])
def test_sweep_against_numpy(
    device: Device, vector: int, float64: bool, windows: tuple[Patch, ...]
) -> None:
    """Directions of all three main axes and both senses; a cell sums some 16 rays of order 1."""
    if float64 and not device.info.float64:
        pytest.skip("the device has no double precision")
    tree = random_tree(3)
    cells = OpticalCells.of(tree, patches=tuple(patch.name for patch in windows))
    patches = patch_rows(windows, tree.frame)
    defines: dict[str, Any] = {**cells.needs.defines, "BOUNDARY_DISC": 1}
    if float64:
        defines["USE_FLOAT64"] = 1
    sized = {**defines, **sweep_defines(device), "VECTOR": vector}
    sweeper = Sweeper(
        device,
        cells,
        build(device, "sweep.cl", sized),
        build(device, "iterate.cl", defines),
        disc=DISC,
        patches=patches,
    )
    rng = np.random.default_rng(5)
    directions = isotropic(12, rng)
    starts = rng.random((12, 2))
    guess = first_guess(sweeper, cells.albedo)
    sweeper.set_source(guess, shining=True)
    sweeper.sweep(sweeper.rays(directions, starts), shining=True)
    got = sweeper.next_order()

    box = sweeper.box
    depth = cells.dense(box, cells.depth)
    planes = source_planes(cells)
    planes[:, cells.address] = guess
    source = np.stack([cells.dense(box, plane) for plane in planes])
    excess = np.zeros_like(source)
    for unit, weight, start in zip(directions.unit, directions.weight, starts, strict=True):
        excess += sweep(
            depth,
            source,
            back=unit,
            weight=float(weight),
            start=start,
            centre=DISC[:3] - box.low,
            radius=4.0,
            patches=shifted(patches, -np.array(box.low, float)),
        )[0]
    if windows:
        assert np.all(excess[2:4].reshape(2, -1).max(axis=1) > 0.01)  # both are seen
    place = cells.place(box, cells.address)
    mean = (source + excess).reshape(len(source), -1)[:, place]
    expected = cells.albedo * mean + sweeper.thermal
    # Twelve rays through at most 16 cells, each a few roundings; a ray that crosses a cell boundary
    # within rounding (none at this seed) would differ by far more.
    np.testing.assert_allclose(got, expected, atol=1e-13 if float64 else 1e-6)


def moments(
    device: Device, cells: OpticalCells, flags: dict[str, Any], *, vector: int
) -> dict[str, NDArray[np.floating]]:
    """Of the kernel ("got") and of the NumPy twin ("expected") moments of the light
    (9, C, N), by twelve directions, from a source by chance; "given": that source, (1 or 9, C, N),
    "changes": how it changes across cells (3, C, M); "more": with ACROSS, how much more the
    light does, and "expected more"."""
    defines: dict[str, Any] = {**cells.needs.defines, "BOUNDARY_DISC": 1, "VECTOR": vector}
    program = build(device, "sweep.cl", {**defines, **flags, "FLUX": 1})
    rng = np.random.default_rng(5)
    changing = rng.random(len(cells.address)) < 0.3 if "ACROSS" in flags else None
    iterate = build(device, "iterate.cl", defines)
    sweeper = Sweeper(device, cells, program, iterate, disc=DISC, changing=changing)
    directions, starts = isotropic(12, rng), rng.random((12, 2))
    moments = MOMENTS if "SLOPED" in flags else 1
    given = rng.uniform(-0.3, 1.0, (moments, sweeper.components, sweeper.count))
    changes = rng.uniform(-0.5, 0.5, (3, sweeper.components, len(sweeper.changing)))
    sweeper.set_source(
        given.reshape(-1, sweeper.count),
        shining=True,
        changes=None if changing is None else changes,
    )
    if sweeper.gradients is not None:
        changes = sweeper.gradients(given[0])
    got = np.empty((MOMENTS, sweeper.components, sweeper.count), sweeper.real)
    rays, room = sweeper.rays(directions, starts), sweeper.room(MOMENTS)
    more = sweeper.moments(program, rays, out=got, room=room)

    box = sweeper.box
    planes = np.zeros((MOMENTS + 3, sweeper.components, len(cells.depth)))
    planes[0] = source_planes(cells)
    planes[:moments, :, cells.address] = given
    planes[MOMENTS:, :, cells.address[sweeper.changing]] = changes
    dense = np.array([[cells.dense(box, plane) for plane in some] for some in planes])
    expected = np.zeros_like(dense[:MOMENTS])
    across = np.zeros_like(dense[:3])
    for unit, weight, start in zip(directions.unit, directions.weight, starts, strict=True):
        excess = sweep(
            cells.dense(box, cells.depth),
            dense[0],
            back=unit,
            weight=float(weight),
            start=start,
            centre=DISC[:3] - box.low,
            radius=4.0,
            slope=dense[1:MOMENTS],
            across=dense[MOMENTS:],
        )
        expected += np.multiply.outer(
            [1.0, *found(unit[None])[:, 0]], weight * dense[0] + excess[0]
        )
        across += excess[1:]
    total = directions.weight.sum()
    expected[1:] -= np.multiply.outer(found(directions.unit) @ directions.weight, expected[0])
    place = cells.place(box, cells.address)
    both = {
        "got": got,
        "expected": expected.reshape(MOMENTS, len(dense[0]), -1)[:, :, place],
        "given": given,
        "changes": changes,
    }
    if more is not None:
        here = place[sweeper.changing]
        both["more"] = more
        both["expected more"] = 12 / total * across.reshape(3, len(dense[0]), -1)[:, :, here]
    return both


@pytest.mark.parametrize("vector", [1, 8])
def test_moments_against_numpy(device: Device, vector: int) -> None:
    """Sources that are more in one direction than in others, and the moments of the light."""
    cells = OpticalCells.of(random_tree(3))
    light = moments(device, cells, {"SLOPED": 1}, vector=vector)
    # As above: a ray's few roundings in each of at most 16 cells.
    np.testing.assert_allclose(light["got"], light["expected"], atol=2e-6)


@pytest.mark.parametrize("vector", [1, 8])
@pytest.mark.parametrize("sloped", [False, True])
def test_gradients_against_numpy(device: Device, vector: int, sloped: bool) -> None:
    """Sources that change across their cells, with and without moments."""
    tree = random_tree(3)
    fields = {name: 8 * values for name, values in tree.fields.items()}
    every = OpticalCells.of(tree)
    clear = every.positions(every.address)[:, 1] % 2 == 0  # whole groups of cells, of either order
    fields["droplet_scattering"][every.address[clear]] = 0.0
    fields["droplet_absorption"] = fields["droplet_absorption"] / 1e3
    fields["vapour_absorption"] = fields["vapour_absorption"] / 1e5
    cells = OpticalCells.of(replace(tree, fields=fields))
    flags: dict[str, Any] = {"LINEAR": 1, **({"SLOPED": 1} if sloped else {})}
    light = moments(device, cells, flags, vector=vector)
    assert np.mean(np.any(light["changes"] != 0, axis=(0, 1))) > 0.2  # the test is of something
    # A few roundings in each of at most 16 cells; `rising` is the difference of numbers next to 1.
    np.testing.assert_allclose(light["got"], light["expected"], atol=4e-6)


@pytest.mark.parametrize("vector", [1, 8])
@pytest.mark.parametrize("deeper", [1e-3, 1.0, 30.0])
def test_light_across_cells_against_numpy(device: Device, vector: int, deeper: float) -> None:
    """How light changes across some cells, in thin and in thick ones, where sources change as well:
    the twin integrates it along every ray."""
    tree = random_tree(3)
    cells = OpticalCells.of(
        replace(tree, fields={name: deeper * values for name, values in tree.fields.items()})
    )
    light = moments(device, cells, {"LINEAR": 1, "SLOPED": 1, "ACROSS": 1}, vector=vector)
    np.testing.assert_allclose(light["got"], light["expected"], atol=4e-6)
    # Twelve times as much as the means; sources of 3 in all, where they have a slope.
    np.testing.assert_allclose(light["more"], light["expected more"], atol=5e-5)


def test_light_in_opaque_cells_changes_as_their_source(device: Device) -> None:
    """It is that source, but for a skin of some 1e-5 of a cell, twelve times of which counts."""
    tree = random_tree(3)
    fields = {name: 1e6 * values for name, values in tree.fields.items()}
    cells = OpticalCells.of(replace(tree, fields=fields))
    light = moments(device, cells, {"LINEAR": 1, "ACROSS": 1}, vector=8)
    assert np.abs(light["changes"]).max() > 0.3
    assert np.abs(light["more"]).max() < 5e-4


def test_sweep_of_one_row_is_exact(device: Device) -> None:
    """Along an axis the sweep is the exact solution: Beer-Lambert through the cells."""
    tree = random_tree(4, scattering=1e-9)
    cells = OpticalCells.of(tree)
    sweeper = sweeper_of(device, cells, {"BOUNDARY_ENCLOSURE": 1})
    along = Directions(unit=np.array([[0.0, 1.0, 0.0]]), weight=np.ones(1))
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    sweeper.sweep(sweeper.rays(along, np.zeros((1, 2))), shining=True)
    mean = sweeper.next_order()[0] - sweeper.thermal[0]
    depth = cells.dense(sweeper.box, cells.depth)
    beyond = np.cumsum(depth[:, ::-1], axis=1)[:, ::-1] - depth
    expected = np.exp(-beyond) * np.where(depth > 0, -np.expm1(-depth) / np.maximum(depth, 1e-9), 1)
    place = cells.place(sweeper.box, cells.address)
    np.testing.assert_allclose(mean / cells.albedo, expected.reshape(-1)[place], rtol=2e-6)


@pytest.mark.parametrize("model", ["pinhole", "orthographic"])
def test_image_against_numpy(device: Device, model: str) -> None:
    """Order 0 of a random medium, ray by ray, against independently computed cell crossings."""
    tree = random_tree(6)
    scene = parse_scene(
        {
            "name": "random",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 15.9},
            "spray": {"model": "none"},
            "camera": {
                "model": model,
                "distance_m": 0.3,
                "field_m": [0.15, 0.12],
                "pixels": [9, 7],
            },
            "background": {"radius_m": 0.03},
        }
    )
    settings = Settings(
        directions=8,
        final_directions=16,
        tolerance=1e-3,
        order=0,
        cutoff=0.0,
        precision="float32",
        seed=1,
    )
    got = trace(tree, scene, device, settings)
    cells = OpticalCells.of(tree)
    planes = source_planes(cells)
    planes[1, cells.address] += cells.albedo
    whole = type(cells.box())(low=(0, 0, 0), shape=(16, 16, 16))
    source = np.stack([cells.dense(whole, plane) for plane in planes])
    depth = cells.dense(whole, cells.depth)
    cell = tree.frame.cell_m
    for row in range(7):
        for column in range(9):
            x = (column + 0.5 - 4.5) * 0.15 / 9
            z = (3.5 - row - 0.5) * 0.12 / 7
            point = np.array([x, 0.0, z]) / cell + 8.0
            toward = np.array([x, 0.3, z]) if model == "pinhole" else np.array([0.0, 1.0, 0.0])
            toward = toward / np.linalg.norm(toward)
            light, left = march(depth, source, point=point, toward=toward)
            hit = point + (16.0 - point[1]) / toward[1] * toward
            on_disc = np.hypot(hit[0] - 8, hit[2] - 8) <= 3.0
            expected = light + left * np.array([on_disc, not on_disc, 0, 0])
            values = [
                got.weights.background[row, column],
                got.weights.wall[row, column],
                got.weights.vapour[row, column] / cells.scale,
                got.weights.liquid[row, column] / cells.scale,
            ]
            # 16 cells, each placed to 1e-6 of its edge and rounded a few times.
            np.testing.assert_allclose(values, expected, atol=3e-6)


def test_sweeps_repeat_to_the_last_bit(device: Device) -> None:
    """Work-groups that add to the same cells never run at the same time: many slanted directions,
    over and over, always give the same sums."""
    tree = random_tree(6, cells=32)
    cells = OpticalCells.of(tree)
    sweeper = sweeper_of(device, cells, {"BOUNDARY_DISC": 1})
    rng = np.random.default_rng(2)
    directions, starts = isotropic(24, rng), rng.random((24, 2))
    found = []
    for _ in range(6):
        sweeper.set_source(first_guess(sweeper, cells.albedo), shining=True)
        sweeper.sweep(sweeper.rays(directions, starts), shining=True)
        found.append(sweeper.next_order())
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_one_sweeper_at_a_time(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a phase function two media are swept, each of which fills its sweeper: the solver's is
    gone, with all its buffers, before the other is made; and no room outlives its sweeps."""
    alive: weakref.WeakSet[Sweeper] = weakref.WeakSet()
    made = []
    init = Sweeper.__init__

    def counted(self: Sweeper, *given: Any, **named: Any) -> None:
        made.append(len(alive))
        alive.add(self)
        init(self, *given, **named)

    monkeypatch.setattr(Sweeper, "__init__", counted)
    scene = parse_scene(
        {
            "name": "random",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 15.9},
            "spray": {"model": "none"},
            "camera": {"distance_m": 0.3, "field_m": [0.15, 0.12], "pixels": [9, 7]},
            "background": {"radius_m": 0.03},
        }
    )
    settings = Settings(
        directions=8,
        final_directions=16,
        tolerance=1e-3,
        order=None,
        cutoff=1e-4,
        precision="float32",
        seed=1,
        phase=henyey_greenstein(0.8),
        max_samples=64,
        accuracy_K=10.0,
        audit=False,
    )
    trace(random_tree(6), scene, device, settings)
    assert made == [0, 0]
    assert not alive


def test_light_kept_in_thick_cells(device: Device) -> None:
    """In a medium that takes nothing out every cell sees what is outside, along every direction: as
    the mean over a layer's steps, whose shares make 1, whichever they are."""
    tree = random_tree(3)
    clear = replace(tree, fields={name: 1e-9 * values for name, values in tree.fields.items()})
    cells = OpticalCells.of(clear)
    thick = ThickCells.of(cells, cells.box(), deeper_than=6e-10)
    assert thick is not None
    flags = {**cells.needs.defines, "BOUNDARY_DISC": 1, "CAMERA_ORTHOGRAPHIC": 1}
    flags |= {"TO_CAMERA": 1, "RIM": 1}
    sweeper = sweeper_of(device, cells, flags)
    program = build(device, "sweep.cl", {**flags, **sweep_defines(device)})
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
    camera = sweeper.to_camera(program, cells, np.zeros(1), np.zeros(3))
    sweeper.set_source(np.zeros_like(sweeper.thermal), shining=False)
    mean = sweeper.weighted_mean(replace(camera, light=light), rays)
    shape = (14, thick.rim, sweeper.components)
    kept = download(device, light.buffer, np.empty(shape, np.float32))
    own = thick.own[thick.own >= 0]
    np.testing.assert_allclose(kept[:, own].sum(axis=2), 1.0, rtol=3e-7)
    assert 0.01 < kept[:, own, 0].mean() < 0.5  # some of it is the background's
    of_each = np.einsum("k,kno->no", rays.directions.weight, kept[:, own])
    order = np.argsort(own)
    np.testing.assert_allclose(of_each[order].T, mean[:, thick.listed], atol=1e-5)


def test_records_of_filled_cells() -> None:
    """Sources of both pictures lie where the kernel looks for them; thick cells scatter the light
    that is expected in them; and in every cell what comes from outside and what is emitted at
    radiance 1 make 1."""
    medium = OpticalCells.of(random_tree(8))
    rng = np.random.default_rng(6)
    filled = Filled.of(medium)
    assert np.array_equal(np.flatnonzero(filled.number >= 0), np.flatnonzero(medium.depth > 0))
    cells, count = len(medium.address), len(medium.needs.components)
    listed = [rng.random((count, cells)) / 8 for _ in range(2)]
    thick = np.flatnonzero(rng.random(cells) < 0.3)
    expected = rng.random((count, len(thick))) / 8
    records = filled.records(list(listed), np.zeros(cells), thick, expected, np.float64)
    assert records.shape == (len(filled.at), 2 + 2 * (count + 1))
    np.testing.assert_array_equal(records[:, 0], medium.depth[filled.at])
    row = filled.number[medium.address]
    plain = np.setdiff1d(np.arange(cells), thick)
    np.testing.assert_array_equal(records[row[thick], 1], medium.albedo[thick])
    assert not records[row[plain], 1].any()
    for picture, source in enumerate(listed):
        mine = records[:, 2 + picture * (count + 1) : 2 + (picture + 1) * (count + 1)]
        np.testing.assert_array_equal(mine[row[plain], :-1], source[:, plain].T)
        sent = medium.albedo[thick] * expected
        sent[2:] += medium.thermal_planes(np.float64)[:, medium.address[thick]]
        np.testing.assert_array_equal(mine[row[thick], :-1], sent.T)
        whole = mine[:, :2].sum(axis=1) + mine[:, -1]
        np.testing.assert_allclose(whole, 1.0, rtol=1e-12)
