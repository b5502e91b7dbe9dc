"""Sweeps by ray, as GPUs make them, against sweeps by tile, in every variant of sweep.cl."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.gpu.buffers import clear, download
from cldit.gpu.device import Device
from cldit.gpu.program import Program
from cldit.transport.angular_moments import MOMENTS
from cldit.transport.boundary import patch_rows
from cldit.transport.cells import OpticalCells
from cldit.transport.discrete_ordinates.blurred_boundary import SIDE, upload_blurred
from cldit.transport.discrete_ordinates.camera_sweep import CameraSweep
from cldit.transport.discrete_ordinates.interface_radiance import InterfaceRadiance
from cldit.transport.discrete_ordinates.quadrature import isotropic
from cldit.transport.phase import PHASE_STEPS
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning

from .medium import random_tree, sweep_program, sweeper_of
from .test_sweep import WINDOWS

COUNT = 14
TILES: dict[str, Any] = {"SIMD_WIDTH": 8}
BY_RAY: dict[str, Any] = {"SIMD_WIDTH": 1}
WORDS: dict[str, Any] = {"SIMD_WIDTH": 1, "FIXED_POINT_WORDS": 1}
SPATIAL = {"LINEAR_SOURCE": 1, "SPATIAL_MOMENTS": 1}
CAMERA = {"CAMERA_SWEEP": 1, "PHASE_STEPS": PHASE_STEPS}
VARIANTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "linear": {"LINEAR_SOURCE": 1},
    "angular": {"MOMENT_SOURCE": 1, "ANGULAR_MOMENTS": 1, **SPATIAL},
    "double": {"USE_FLOAT64": 1, "ANGULAR_MOMENTS": 1},
    "interfaces": {"INTERFACE_RADIANCE": 1, **SPATIAL},
    "camera": {**CAMERA, "PHASE_CLASSES": 2, "MOMENT_SOURCE": 1, **SPATIAL},
    "blurred": {**CAMERA, "BLURRED_BOUNDARY": SIDE, "INTERFACE_RADIANCE": 1, **SPATIAL},
    "seen": {**CAMERA, "VIEW_TRANSMISSION": 1},
}


def swept(
    device: Device, variant: dict[str, Any], way: dict[str, Any]
) -> dict[str, NDArray[np.floating]]:
    """All results of a sweep of a random source through random cells, with patches."""
    tree = random_tree(3)
    cells = OpticalCells.of(tree, patches=tuple(patch.name for patch in WINDOWS))
    rng = np.random.default_rng(5)
    defines = {**variant, **way}
    program = sweep_program(device, cells, defines)
    linear_cells = rng.random(len(cells.address)) < 0.3 if "LINEAR_SOURCE" in variant else None
    patches = patch_rows(WINDOWS, tree.frame)
    sweeper = sweeper_of(device, cells, defines, patches=patches, linear_cells=linear_cells)
    moments = MOMENTS if "MOMENT_SOURCE" in variant else 1
    source = rng.uniform(-0.3, 1.0, (moments * sweeper.components, sweeper.count))
    changes = rng.uniform(-0.5, 0.5, (3, sweeper.components, len(sweeper.linear_cells)))
    sweeper.set_source(source, shining=True, gradient=changes if linear_cells is not None else None)
    rays = sweeper.rays(isotropic(COUNT, rng), rng.random((COUNT, 2)))
    results: dict[str, Any] = {}
    light = None
    if "INTERFACE_RADIANCE" in variant:
        deeper = float(np.median(cells.depth[cells.address]))
        thick = ThickRegion.of(cells, sweeper.box, deeper_than=deeper, tuning=Tuning())
        assert thick is not None
        light = InterfaceRadiance.of(
            device,
            thick,
            sweeper.box,
            components=sweeper.ray_planes,
            directions=COUNT,
            real=sweeper.real,
        )
        clear(device, light.buffer, light.interfaces * COUNT * light.components, sweeper.real)
    if "CAMERA_SWEEP" in variant:
        blurred = None
        if "BLURRED_BOUNDARY" in variant:
            maps = rng.uniform(-0.1, 1.1, (COUNT, 1 + len(WINDOWS), SIDE, SIDE))
            frames = rng.uniform(-0.3, 0.3, (COUNT, 2, 4))
            frames[..., 3] += 2.0
            blurred = upload_blurred(device, maps, frames, np.float32)
        classes = rng.random((variant.get("PHASE_CLASSES", 1), len(cells.depth)))
        camera = CameraSweep.of(
            sweeper.boxes,
            program,
            cells,
            phase=rng.uniform(0.5, 2.0, len(classes) * PHASE_STEPS),
            place=np.zeros(4),
            classes=classes if len(classes) > 1 else None,
        )
        mean, more = sweeper.view_weighted_mean(camera, rays, light, blurred)
    else:
        many = MOMENTS if "ANGULAR_MOMENTS" in variant else 1
        out, room = sweeper.unset_light(many), sweeper.room(many)
        found = sweeper.moments(program, rays, out=out, room=room, interfaces=light)
        mean = sweeper.read(out, many)
        more = None if found is None else sweeper.read_gradient(found)
    results["mean"] = mean
    if more is not None:
        results["gradient"] = more
    if light is not None:
        shape = (light.interfaces, COUNT, light.components)
        results["stored"] = download(device, light.buffer, np.empty(shape, sweeper.real))
    return results


# These have the code of all others, but for double precision and VIEW_TRANSMISSION.
FIRST = ("angular", "blurred")


@pytest.mark.parametrize(
    "variant",
    [name if name in FIRST else pytest.param(name, marks=pytest.mark.slow) for name in VARIANTS],
)
def test_sweeps_by_ray_are_those_by_tile(device: Device, variant: str) -> None:
    """To 1e-6 of the means; a gradient is 12 times a moment."""
    flags = VARIANTS[variant]
    if "USE_FLOAT64" in flags and not device.info.float64:
        pytest.skip("the device has no double precision")
    tiles, rays = swept(device, flags, TILES), swept(device, flags, BY_RAY)
    assert tiles.keys() == rays.keys()
    most = 1e-12 if "USE_FLOAT64" in flags else 1e-6
    for name, expected in tiles.items():
        assert np.abs(expected).max() > 0.3
        scale = 12 if name == "gradient" else 1
        np.testing.assert_allclose(rays[name], expected, rtol=0, atol=scale * most, err_msg=name)


@pytest.mark.parametrize(
    "variant",
    ["plain", *(pytest.param(name, marks=pytest.mark.slow) for name in ("double", "camera"))],
)
def test_sums_in_two_words_have_the_same_bits(device: Device, variant: str) -> None:
    """Of 32 bits each, in another sweep."""
    if "USE_FLOAT64" in VARIANTS[variant] and not device.info.float64:
        pytest.skip("the device has no double precision")
    rays, again = (swept(device, VARIANTS[variant], way) for way in (BY_RAY, WORDS))
    for name, expected in rays.items():
        np.testing.assert_array_equal(again[name], expected)


def test_rays_fill_a_gpu_with_few_launches(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sweep by ray is one launch for each order of axes, however many ordinates it has."""
    cells = OpticalCells.of(random_tree(3))
    sweeper = sweeper_of(device, cells, BY_RAY)
    rng = np.random.default_rng(1)
    rays = sweeper.rays(isotropic(200, rng), rng.random((200, 2)))
    launches: list[str] = []
    launch = Program.launch

    def counted(self: Program, kernel: str, *rest: Any, **more: Any) -> None:
        launches.append(kernel)
        launch(self, kernel, *rest, **more)

    monkeypatch.setattr(Program, "launch", counted)
    sweeper.sweep(rays, shining=True)
    assert launches.count("sweep") == 3
