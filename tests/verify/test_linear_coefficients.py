"""Coefficients that are linear in cells: convergence to a smooth medium, and one medium for all
methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from cldit.arrays import Floats
from cldit.gpu.device import Device
from cldit.medium.frame import Cube
from cldit.medium.octree import Octree, build_octree
from cldit.scene import Scene, parse_scene
from cldit.transport.cells import OpticalCells
from cldit.transport.phase import ScatteringTable
from cldit.transport.result import Method
from cldit.transport.trace import TraceSettings, trace
from tests.kernels.cell_twin import LinearCoefficients
from tests.kernels.medium import cells_source
from tests.phase_tables import henyey_greenstein

EDGE_M, SIGMA_M, PIXELS = 0.16, 0.012, 37
CENTRE_M = np.array([0.0013, -0.0021, 0.0017])  # nowhere a centre of cells
HOT_M = np.array([0.006, 0.0, -0.004])  # centre of what emits, with the same width
DEPTH, EMISSION = 1.5, 2.0
SETTINGS = TraceSettings(
    directions=16,
    final_directions=96,
    tolerance=1e-4,
    order=None,
    cutoff=1e-7,
    precision="float32",
    seed=1,
)


def gaussian(cells: int, centre_m: Floats) -> Floats:
    """Exact cell means (x, y, z) of a Gaussian whose integral through the middle is 1."""
    edges = EDGE_M * (np.arange(cells + 1) / cells - 0.5)
    x, y, z = (np.diff(ndtr((edges - at) / SIGMA_M)) for at in centre_m)
    whole = 2 * np.pi * SIGMA_M**2 / (EDGE_M / cells) ** 3
    return np.asarray(whole * x[:, None, None] * y[:, None] * z)


def medium(cells: int, *, albedo: float = 0.0, gas: float = 0.0) -> Octree:
    """Droplets of Gaussian extinction, and gas of `gas` times that around another middle."""
    frame = Cube(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=cells.bit_length() - 1)
    droplets, other = DEPTH * gaussian(cells, CENTRE_M), gaussian(cells, HOT_M)
    place = np.argwhere((droplets + other) * frame.cell_m > 1e-8)
    at = tuple(place.T)
    source = cells_source(
        frame,
        place,
        vapour_absorption=gas * other[at],
        vapour_emission=0.7 * gas * other[at],
        droplet_absorption=(1 - albedo) * droplets[at],
        droplet_scattering=albedo * droplets[at],
        droplet_emission=np.asarray(EMISSION * (1 - albedo) * other[at] * droplets[at] * 0.02),
    )
    return build_octree(frame, None, [source], optical_depth_split=1e-9)


def scene(model: str = "pinhole", **keys: object) -> Scene:
    return parse_scene(
        {
            "name": "gaussian",
            "domain": {"edge_m": EDGE_M, "leaf_edge_m": EDGE_M / 127},
            "spray": {"model": "none"},
            "camera": {"field_m": [0.08, 0.08], "pixels": [PIXELS, PIXELS], "model": model},
            "background": {"radius_m": 0.5, "centre_m": [0.0, EDGE_M / 2 + 0.001, 0.0]},
            **keys,
        }
    )


def exact_transmission(model: str) -> Floats:
    """exp(-depth) of every line of sight, from a camera 1 m away."""
    place = (np.arange(PIXELS) + 0.5 - PIXELS / 2) * 0.08 / PIXELS
    x, z = np.meshgrid(place, -place)
    along = np.stack([x, np.ones_like(x), z], axis=2) * [1, 1, 1]
    camera = np.array([0.0, -1.0, 0.0]) - CENTRE_M
    square = np.sum(camera**2) - (along @ camera) ** 2 / np.sum(along**2, axis=2)
    if model == "orthographic":
        square = (x - CENTRE_M[0]) ** 2 + (z - CENTRE_M[2]) ** 2
    return np.asarray(np.exp(-DEPTH * np.exp(-square / (2 * SIGMA_M**2))))


def rms(difference: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.mean(difference**2)))


@pytest.mark.parametrize("model", [pytest.param("orthographic", marks=pytest.mark.slow), "pinhole"])
def test_transmission_is_of_second_order(device: Device, model: str) -> None:
    """Along lines of sight that run askew to the cells too. Constant cells have the first order
    along the axes; askew their errors cancel in part. The means are the same, so that in the mean
    over the picture all converge faster."""
    errors = {}
    for linear in (False, True):
        settings = replace(SETTINGS, linear_coefficients=linear)
        errors[linear] = [
            rms(
                trace(medium(cells), scene(model), device, settings).weights.background
                - exact_transmission(model)
            )
            for cells in (16, 32, 64, 128)
        ]
    orders = {linear: np.log2(found[0] / found[-1]) / 3 for linear, found in errors.items()}
    assert orders[True] > 1.8, errors
    assert orders[False] < 1.5, errors
    assert errors[True][-1] < errors[False][-1] / 10


def test_emission_is_of_second_order(device: Device) -> None:
    """Of two phases whose emission over extinction varies: against cells of half the finest edge.
    Their own error is a quarter of the finest one's, which lowers the order that is seen by 0.1."""
    settings = replace(SETTINGS, linear_coefficients=True)
    lines = scene("orthographic")

    def image(cells: int, linear: bool) -> Floats:
        got = trace(
            medium(cells, gas=0.4), lines, device, replace(settings, linear_coefficients=linear)
        ).weights
        return np.stack([got.vapour, got.liquid]).astype(np.float64)

    truth = image(128, True)
    found, even = ([rms(image(cells, on) - truth) for cells in (16, 64)] for on in (True, False))
    assert np.log2(found[0] / found[1]) / 2 > 1.7, (found, even)
    assert found[1] < even[1] / 5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "thick_depth"),
    [(1, 0.5), (None, 0.5), (None, 0.02)],
)
def test_path_and_source_see_one_medium(
    device: Device, order: int | None, thick_depth: float
) -> None:
    """In cells so large that constant ones differ by far more. What is left is noise of the paths,
    and that the sweeps of `source` have constant cells.

    No cell has a depth of 0.5; most of what is seen has 0.02, so that the final gather scatters.
    Its 32 paths leave 0.018 of the walls' weight, so emission alone is compared there: 0.003 and
    0.004 are found, and 0.012 and 0.015 where thick cells emit evenly."""
    tree = medium(32, albedo=0.5, gas=0.4)
    settings = replace(
        SETTINGS, linear_coefficients=True, order=order, audit=False, thick_depth=thick_depth
    )
    source = trace(tree, scene(), device, settings)
    samples = replace(settings, method="path", accuracy_K=0.0, max_samples=1024)
    path = trace(tree, scene(), device, samples)
    even = trace(tree, scene(), device, replace(settings, linear_coefficients=False))
    gathered = "samples" in source.counts
    assert gathered == (thick_depth < 0.5)
    for name, image in source.weights.images.items():
        if gathered and name not in ("vapour", "liquid"):
            continue
        size = float(np.abs(image).max())
        error = rms((image - path.weights.images[name]) / size)
        assert error < 0.008, name
        other = rms((even.weights.images[name] - path.weights.images[name]) / size)
        assert other > 3 * error, (name, error, other)


@pytest.mark.parametrize(
    ("method", "phase"),
    [
        pytest.param("source", None, marks=pytest.mark.slow),
        ("source", henyey_greenstein(0.86)),
        pytest.param("path", None, marks=pytest.mark.slow),
        pytest.param("path", henyey_greenstein(0.86), marks=pytest.mark.slow),
        ("branching", None),
    ],
    ids=["source", "source-forward", "path", "path-forward", "branching"],
)
def test_cavity_is_flat(device: Device, method: Method, phase: ScatteringTable | None) -> None:
    """Weights lie in 0 to 1 and those of an isothermal cavity sum to 1, whatever the gradients."""
    rng = np.random.default_rng(4)
    frame = Cube(lower_m=(-EDGE_M / 2,) * 3, edge_m=EDGE_M, depth=4)
    place = np.argwhere(rng.random((16, 16, 16)) < 0.5)
    gas, absorbing, scattering = 10.0 ** rng.uniform(-2, 1.7, (3, len(place)))
    source = cells_source(
        frame,
        place,
        vapour_absorption=gas,
        vapour_emission=gas,
        droplet_absorption=absorbing,
        droplet_scattering=scattering,
        droplet_emission=absorbing,
    )
    tree = build_octree(frame, None, [source], optical_depth_split=1e-9)
    assert np.abs(LinearCoefficients.of(device, OpticalCells.of(tree)).extinction).max() > 1
    chosen = replace(
        SETTINGS, method=method, linear_coefficients=True, accuracy_K=0.5, max_samples=512,
        order=1 if method == "branching" else None, audit=False, phase=phase,
    )  # fmt: skip
    got = trace(tree, scene(), device, chosen).weights
    images = np.stack(list(got.images.values()))
    assert images.min() > -1e-5
    # Paths of 512 samples have a noise of 0.02 at most, and 4 of it in one of 1369 pixels.
    noise = {"source": 3e-4, "path": 0.12, "branching": 0.12}[method]
    np.testing.assert_allclose(images.sum(axis=0), 1.0, atol=noise)
    assert abs(images.sum(axis=0).mean() - 1.0) < 0.003
