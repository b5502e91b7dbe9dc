"""Records of cells, as the image kernel reads them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.buffers import download, upload
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, Octree, build_octree
from cldit.transport.cell_records import CellRecords, Sources
from cldit.transport.cells import OpticalCells
from cldit.transport.linear_coefficients import device_cells, thick_albedo

from .cell_twin import RecordsTwin, linear_of, middles_of, spatial_gradients
from .medium import random_tree


def test_records_of_filled_cells() -> None:
    """Sources of both images lie where the kernel reads them, and thick cells have their emission
    alone. Elsewhere the boundary's part and the emission at radiance 1 sum to 1."""
    medium = OpticalCells.of(random_tree(8))
    rng = np.random.default_rng(6)
    made = RecordsTwin.of(medium)
    assert np.array_equal(np.flatnonzero(made.number >= 0), np.flatnonzero(medium.depth > 0))
    cells, count = len(medium.address), len(medium.needs.components)
    listed = [rng.random((count, cells)) / 8 for _ in range(2)]
    thick = np.flatnonzero(rng.random(cells) < 0.3)
    records = made.records(list(listed), np.zeros(cells), thick, np.float64)
    assert records.shape == (len(made.at), 2 + 2 * (count + 1))
    np.testing.assert_array_equal(records[:, 0], medium.depth[made.at])
    row = made.number[medium.address]
    plain = np.setdiff1d(np.arange(cells), thick)
    np.testing.assert_array_equal(records[row[thick], 1], medium.albedo[thick])
    assert not records[row[plain], 1].any()
    for image, source in enumerate(listed):
        mine = records[:, 2 + image * (count + 1) : 2 + (image + 1) * (count + 1)]
        np.testing.assert_array_equal(mine[row[plain], :-1], source[:, plain].T)
        emitted = np.zeros((count, len(thick)))
        emitted[2:] = medium.thermal_planes(np.float64)[:, medium.address[thick]]
        np.testing.assert_array_equal(mine[row[thick], :-1], emitted.T)
        whole = mine[:, :2].sum(axis=1) + mine[:, -1]
        whole[row[thick]] += medium.albedo[thick]  # the gather's
        np.testing.assert_allclose(whole, 1.0, rtol=1e-12)


CELLS = 64
FRAME = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=0.64, depth=6)


def tree_of(*, scattering: float = 1.0, vapour: float = 1.0) -> Octree:
    """Random cells in blocks, at a side of the cube, empty ones among them, beside coarse leaves of
    which some are empty."""
    rng = np.random.default_rng(5)
    place = np.argwhere(rng.random((CELLS, CELLS, CELLS)) < 0.7)
    block = np.all((place >= [0, 8, 16]) & (place < [20, 30, 32]), axis=1)
    faint = np.all(place >= [32, 0, 0], axis=1)
    kept = block | faint
    size = np.where(block, 1.0, 1e-9)[kept] / FRAME.cell_m
    gas, drops, scattered = rng.uniform(0.02, 0.5, (3, len(size))) * size
    drops, scattered = drops * block[kept], scattered * block[kept]  # coarse leaves have none
    lower = np.asarray(place[kept] * FRAME.cell_m, np.float64)
    source = CellSource(
        lower_m=lower,
        upper_m=lower + FRAME.cell_m,
        vapour_absorption=vapour * gas,
        vapour_emission=vapour * gas * rng.uniform(0.1, 1.0, len(size)),
        droplet_absorption=drops,
        droplet_scattering=scattering * scattered,
        droplet_emission=drops * rng.uniform(0.1, 1.0, len(size)),
    )
    return build_octree(FRAME, None, [source], optical_depth_split=1e-6)


@pytest.fixture(
    params=[np.float32, pytest.param(np.float64, marks=pytest.mark.slow)], ids=["single", "double"]
)
def real(request: pytest.FixtureRequest, device: Device) -> type[np.floating]:
    if request.param is np.float64 and not device.info.float64:
        pytest.skip("the device has no double precision")
    kind: type[np.floating] = request.param
    return kind


@pytest.mark.parametrize(("scattering", "vapour"), [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
def test_linear_coefficients_are_numpys(
    device: Device, real: type[np.floating], scattering: float, vapour: float
) -> None:
    """The twin's gradients are in single precision, of numbers up to 2."""
    cells = OpticalCells.of(tree_of(scattering=scattering, vapour=vapour))
    assert not vapour or np.any(cells.tree.coarse_level[FRAME.depth + 1 :] < 3)
    got = device_cells(device, cells, real, linear=True)
    count, emitters = len(cells.depth), len(cells.needs.emitters)
    linear, middles = linear_of(cells), middles_of(cells)
    gradients = download(
        device, got["cell_gradients"], np.empty((count, 2 + emitters, 3), real)
    ).astype(float)
    expected = np.stack([linear.extinction, linear.albedo, *linear.emission], axis=1)
    np.testing.assert_allclose(gradients, expected, atol=3e-6)
    assert np.abs(expected).max() > 0.5
    eps = float(np.finfo(real).eps)
    depth = download(device, got["depth"], np.empty(count, real))
    np.testing.assert_allclose(depth, cells.depth, rtol=4 * eps)
    albedo = np.zeros(count)
    albedo[cells.address] = middles.albedo
    np.testing.assert_allclose(
        download(device, got["albedo"], np.empty(count, real)), albedo, atol=2e-6
    )
    thermal = download(device, got["thermal"], np.empty((emitters, count), real))
    np.testing.assert_allclose(thermal, middles.thermal_planes(np.float64), atol=2e-6)
    if scattering:
        thick = np.arange(0, len(cells.address), 3)
        some = thick_albedo(device, cells, thick, real, linear=True)
        found = download(device, some, np.empty(count, real))
        assert np.array_equal(np.flatnonzero(found), cells.address[thick])
        np.testing.assert_allclose(found[found > 0], middles.albedo[thick], atol=2e-6)


CASES: list[dict[str, Any]] = [
    {"linear": True, "gather": True, "known": True},
    {"linear": True, "gather": False},
    {"linear": True, "spatial": False},
    {"linear": True, "scattering": 0.0},
    {"linear": False, "gather": True, "known": True, "vapour": 0.0},
    {"linear": False, "spatial": False},
    {"linear": False, "scattering": 0.0, "spatial": False},
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: " ".join(case))
def test_records_are_numpys(device: Device, real: type[np.floating], case: dict[str, Any]) -> None:
    """With spatial gradients from neighbours, and known ones in some cells. The twin limits
    gradients in single precision."""
    scattering, vapour = case.get("scattering", 1.0), case.get("vapour", 1.0)
    cells = OpticalCells.of(tree_of(scattering=scattering, vapour=vapour))
    linear, spatial = case["linear"], case.get("spatial", True)
    count, parts = len(cells.address), len(cells.needs.components)
    rng = np.random.default_rng(7)
    light = rng.random((2, parts, count)) if scattering else np.zeros((0, parts, 0))
    thermal = cells.thermal_source()
    listed = [(thermal + cells.albedo * one).astype(real) for one in light]
    defect = 1e-3 * rng.normal(size=count)
    thick = np.arange(0, count, 5) if case.get("gather") else None
    known = None
    if case.get("known"):
        known = np.arange(2, count, 11), rng.normal(size=(3, parts, len(range(2, count, 11)))) / 4
    images = max(len(listed), 1)
    defines: dict[str, Any] = {**cells.needs.defines, "IMAGES": images}
    defines |= {"LINEAR_COEFFICIENTS": 1} if linear else {}
    defines |= {"LINEAR_SOURCE": 1} if linear or spatial else {}
    defines |= {"GATHER": 1} if thick is not None else {}
    defines |= {"USE_FLOAT64": 1} if real is np.float64 else {}
    made, twin = CellRecords.of(cells), RecordsTwin.of(cells, linear=linear)
    assert made.count == len(twin.at)
    number = upload(device, "numbers", made.number)
    sources = Sources(listed, defect, spatial and bool(scattering), known)
    got = made.upload(build(device, "image.cl", defines), number, sources, thick)

    gradient = None
    if scattering and spatial:
        gradient = spatial_gradients(light.mean(axis=0), cells, cells.box(), known) * cells.albedo
    given: list[Any] = [one.astype(float) for one in listed] or [None]
    table = None
    if linear:
        given, table = twin.linear_sources(given, gradient, thick)
    elif gradient is not None:
        table = gradient.reshape(-1, count).T.copy()
        if thick is not None:
            table[thick] = 0.0
    expected = twin.records(given, defect, thick, np.float64)
    found = download(device, got["records"], np.empty(expected.shape, real))
    np.testing.assert_allclose(found, expected, atol=5e-6)
    if table is not None:
        steep = download(device, got["gradient"], np.empty(table.shape, real))
        np.testing.assert_allclose(steep, table, atol=2e-5)
        assert np.abs(table).max() > 0.1
        assert got["scattering"] == len(table)
