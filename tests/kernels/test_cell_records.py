"""Records of cells, as the image kernel reads them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cldit.gpu.buffers import download, upload
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.medium.frame import Cube
from cldit.medium.octree import Octree, build_octree
from cldit.transport.cell_records import CellRecords
from cldit.transport.cells import OpticalCells

from .cell_twin import LinearCoefficients, RecordsTwin, spatial_gradients
from .medium import cells_source

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
    source = cells_source(
        FRAME,
        place[kept],
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
    coefficients = LinearCoefficients.of(device, cells, real) if linear else None
    made, twin = CellRecords.of(cells), RecordsTwin.of(cells, coefficients)
    assert made.count == len(twin.at)
    number = upload(device, "numbers", made.number)
    got = made.upload(
        build(device, "image.cl", defines), number, listed, defect,
        spatial=spatial and bool(scattering), thick=thick, known=known,
    )  # fmt: skip

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
