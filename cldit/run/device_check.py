"""Check of an OpenCL device: every kernel of the package on small problems with known results.

The problems are those of whole traces and sprays, on a few cells. Of every kernel, the first two
launches of each variant are compared with the reference: one number for each plane that the kernel
writes, its elements multiplied by fixed weights from 1 to 2 and added up. The launches are compared
in their order, and a problem ends with the first that differs. So the kernel that is named has read
correct numbers. The reference is from PoCL, where the tests compare the kernels with NumPy;
`python -m tests.bench device_reference` makes it.

Tolerances are relative to the sum of the elements' magnitudes. Between single and double precision
on PoCL, traces without random paths differ by 2.3e-6 at most; with other rounding of most steps
(`-cl-fast-relaxed-math`, which is wrong for parallel rays) by 1.5e-6, and sprays by 8e-6. So 2e-5,
5e-6 in double precision, and 1e-4 leave room for the libraries of other drivers; 2e-5 of the light
is 1 mK of T_app. A random path takes another way where rounding changes a decision: by that option
the means of the final gather change by 1.1e-3 at most, those of path tracing by 2e-7. Gas in single
precision has divergences near its rounding, so that only first launches count; its droplets choose
other steps, whose numbers change by up to 8e-3.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import ClditError
from cldit.gpu.buffers import download
from cldit.gpu.checks import Check
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.gpu.program import Program
from cldit.io.caches import default_cache
from cldit.io.plain_data import read_json
from cldit.medium.corners import Corners
from cldit.medium.frame import Cube
from cldit.medium.octree import CellSource, Octree, PointSource, build_octree
from cldit.medium.rasterise import BoxRasteriser, CloudRasteriser, deposit_program
from cldit.optics.scene_phase import henyey_greenstein
from cldit.scene import parse_scene
from cldit.scene.spray import FlowBox, LagrangianSpray
from cldit.spray.droplet.advance import (
    DropletStates,
    DropletSurroundings,
    advance,
    follow_droplets,
)
from cldit.spray.droplet.arrays import DropletKernels
from cldit.spray.droplet.fluids import fuel_table, gas_table
from cldit.spray.droplet.models import MODELS
from cldit.spray.droplet.rates import Drop, rates
from cldit.spray.flow.simulate import simulate_spray
from cldit.transport.phase import ScatteringTable, SizeClasses
from cldit.transport.trace import settings_for, trace

Sum = tuple[float, float]  # of the weighted elements of a buffer, and of their magnitudes
Sums = dict[str, list[Sum]]  # of the planes of a buffer
Problem = Callable[[Device], Any]  # an image, or None

_LAUNCHES = 2  # of each variant of a kernel
_SCRATCH = "rays"  # of sweep.cl: its layout depends on the device
_ROUNDING = {  # see above; gas: of first launches, droplets: both in single precision
    "float32": 2e-5, "float64": 5e-6, "gas": 3e-4, "droplets": 2e-2,
}  # fmt: skip
_SAMPLED = {
    "gather.cl gather": 1e-2,
    "path.cl scatter": 2e-3,
    "branching.cl branching": 2e-3,
    "image": 2e-3,
}
_DEFECT = "source_update.cl cavity_defect"  # radiances less 1, which may be rounding errors alone
_LONG = 70_000  # rounds: llvmpipe ends loops after 65,535
_EDGE_M, _CELLS = 0.16, 16  # of the cube of the octree: cells of 10 mm


class _Differs(Exception):
    """A kernel's result is not that of the reference."""


@dataclass
class Launches:
    """Sums of the planes that kernels write, by kernel, argument and number, in order.

    reference: sums to compare them with, which raises _Differs; None: nothing is compared.
    """

    rounding: float
    reference: Mapping[str, list[Sum]] | None
    sums: Sums = field(default_factory=dict)
    launches: Counter[str] = field(default_factory=Counter)

    def __call__(self, program: Program, kernel: str, arguments: Mapping[str, Any]) -> None:
        """Compares what the first launches of a kernel write."""
        name = f"{program.name} {kernel}"
        variant = f"{name} {sorted(arguments)}"
        self.launches[variant] += 1
        if self.launches[variant] > (1 if self.rounding == _ROUNDING["gas"] else _LAUNCHES):
            return
        for argument in sorted(_written(program.name, kernel) & arguments.keys()):
            buffer = arguments[argument]
            values = np.empty(buffer.size // np.dtype(buffer.dtype).itemsize, buffer.dtype)
            download(program.device, buffer, values)
            self.add(name, argument, _planes(name, argument, arguments, values))

    def add(self, name: str, argument: str, planes: Any) -> None:
        """Adds the sums of planes (P, N)."""
        self.launches[f"{name} {argument}"] += 1
        key = f"{name} {argument} {self.launches[f'{name} {argument}']}"
        self.sums[key] = sums = [_weighted(plane) for plane in planes]
        if self.reference is None:
            return
        expected_sums = self.reference.get(key, [])
        if len(expected_sums) != len(sums):
            raise _Differs(
                f"{name}: {argument} has {len(sums)} planes; allowed: {len(expected_sums)}"
            )
        allowed = _SAMPLED.get(name, self.rounding)
        for plane, (total, _), (expected, size) in zip(planes, sums, expected_sums, strict=True):
            difference = abs(total - expected)
            rounding = np.finfo(plane.dtype).eps * plane.size if name == _DEFECT else 0.0
            if not difference <= max(allowed * size, rounding):
                amount = f"off by {difference / size:.1e}" if size else "not 0"
                raise _Differs(f"{name}: {argument} is {amount}; allowed: {allowed:.0e}")


def _planes(kernel: str, argument: str, arguments: Mapping[str, Any], values: Any) -> Any:
    """Planes of a buffer, which have different units in the kernels of sprays."""
    if argument == "voxels":
        return values.reshape(-1, 2).T
    for name in ("capacity", "cells", "count"):
        size = arguments.get(name, 0) if kernel.startswith("spray/") else 0
        if size > 1 and values.size % size == 0:
            return values.reshape(-1, size)
    return values.reshape(1, -1)


def _weighted(values: Any) -> Sum:
    """Sums of an array, without the elements that nothing has written, see `Device.poison`."""
    is_integer = issubclass(values.dtype.type, np.integer)
    unset = values == np.iinfo(values.dtype).max if is_integer else ~np.isfinite(values)
    elements = np.where(unset, 0, values).astype(np.float64)
    weight = 1.0 + np.arange(elements.size) * 0.6180339887498949 % 1.0
    return float(weight @ elements), float(weight @ np.abs(elements))


@cache
def _written(file: str, kernel: str) -> set[str]:
    """Arguments that a kernel writes: pointers that are not to constant memory."""
    source = re.sub(r"/\*.*?\*/", "", assemble(file), flags=re.DOTALL)
    signature = re.search(rf"\b{kernel}\s*\(([^;{{}}]*?)\)\s*\{{", source)
    assert signature is not None, f"{file}: {kernel}"
    pointers = [
        parameter
        for parameter in signature[1].split(",")
        if "*" in parameter and "const" not in parameter
    ]
    return {pointer.split()[-1].strip("*") for pointer in pointers} - {_SCRATCH}


def _wave(count: int, step: float) -> Any:
    """Numbers from -1 to 1."""
    return np.sin(np.arange(count) * step)


def _deposits(device: Device) -> None:
    """Clouds of all shapes, points whose loops are long as they are in one layer, and boxes."""
    wide = 10.0 ** _wave(90, 2.4).reshape(30, 1, 3)
    sides = _wave(270, 1.3).reshape(30, 3, 3) * wide
    inside = (_CELLS / 2) * (1 + 0.8 * _wave(90, 1.9).reshape(30, 3))
    line = np.stack([(np.arange(_LONG) * 0.618034) % _CELLS] * 2 + [np.full(_LONG, 5.5)], axis=1)
    covariances = sides @ sides.transpose(0, 2, 1), np.zeros((_LONG, 3, 3))
    cube = Cube(lower_m=(0.0, 0.0, 0.0), edge_m=_CELLS, depth=0)
    boxes = Corners.of(cube, inside - 0.7, inside + np.array([0.2, 0.7, 1.6]), "boxes")
    for count, rasteriser in (
        (30, CloudRasteriser.of(device, inside, covariances[0], _CELLS)),
        (_LONG, CloudRasteriser.of(device, line, covariances[1], _CELLS)),
        (30, BoxRasteriser(device, deposit_program(device), _CELLS, boxes)),
    ):
        mark = np.zeros((2, 2, 2), bool)
        rasteriser.mark(mark)
        directory = np.full(mark.shape, -1, np.int32)
        directory[mark] = np.arange(mark.sum())
        amount = 1.5 + _wave(count, 0.7)
        rasteriser.add(directory, [amount], [np.zeros(512 * int(mark.sum()))])


def _medium() -> Octree:
    """Vapour and droplets of two size classes, of optical depths up to 2 a cell."""
    frame = Cube(lower_m=(-_EDGE_M / 2,) * 3, edge_m=_EDGE_M, depth=4)
    low, high = np.array([3, 2, 5]), np.array([11, 12, 13])
    cell = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, z = (cell + 0.5 - (low + high) / 2).T
    gaussian = np.exp(-(x**2 + 0.5 * (y - 1) ** 2 + z**2) / 8)
    lower_m = np.asarray(frame.lower_m) + cell * frame.cell_m
    section_m2 = frame.cell_m**2 * (1e-3 + 1.5 * gaussian) * (1 + 0.3 * _wave(len(cell), 2.4))
    absorption = (0.005 + 0.03 * gaussian) / frame.cell_m
    nothing = np.zeros(len(cell))
    droplets = PointSource(
        position_m=lower_m + frame.cell_m / 2,
        absorption_m2=0.03 * section_m2,
        scattering_m2=section_m2,
        emission_m2=0.03 * section_m2 * (2 + _wave(len(cell), 0.9)),
        class_scattering_m2=(section_m2 * (0.5 + 0.4 * _wave(len(cell), 1.1)),),
    )
    vapour = CellSource(
        lower_m=lower_m,
        upper_m=lower_m + frame.cell_m,
        vapour_absorption=absorption,
        vapour_emission=absorption * (1.5 + _wave(len(cell), 1.7)),
        droplet_absorption=nothing,
        droplet_scattering=nothing,
        droplet_emission=nothing,
    )
    return build_octree(frame, droplets, [vapour], optical_depth_split=1e-5)


def _phase(name: str) -> ScatteringTable | None:
    """Isotropic, one phase function, or those of two classes of size, as Mie's theory has them."""
    if name == "isotropic":
        return None
    mean, *by_class = (ScatteringTable.of(henyey_greenstein(g)) for g in (0.6, 0.4, 0.8))
    classes = SizeClasses(np.array([1e-5]), tuple(by_class), 0.0)
    return mean if name == "forward" else replace(mean, classes=classes)


_PATCH: dict[str, Any] = {
    "name": "flange",
    "centre_m": [0.0, -0.1, 0.05],
    "facing": [0.0, 1.0, 0.0],
}
_PATCH |= {"size_m": [0.1, 0.06], "temperature_K": 400.0}
_CAMERA = {"distance_m": 0.3, "field_m": [0.12, 0.12], "pixels": [8, 8], "rays_per_pixel": 1}
_TRANSPORT = {"audit": False, "accuracy_K": 4.0, "directions": 16, "max_samples": 128}
_PATHS = 64  # of the audit: two batches, whatever their noise is on a device
_PHASES = ("isotropic", "forward", "classes")
_TRACES: dict[str, dict[str, Any]] = {  # sections of a scene
    **{f"source, {name}": {"phase": name} for name in _PHASES},
    "source, parallel rays": {
        "phase": "classes",
        "camera": {"model": "orthographic", "rays_per_pixel": 4},
    },
    "source, audited": {"phase": "forward", "transport": {"audit": True}},
    "source, order 2": {"transport": {"order": 2, "gather": False}, "patches": [_PATCH]},
    "source, long paths": {"camera": {"pixels": [1, 1]}, "samples": 2**13},
    **{f"path, {name}": {"phase": name, "transport": {"method": "path"}} for name in _PHASES},
    "branching": {"transport": {"method": "branching", "order": 1}, "patches": [_PATCH]},
}


def _trace(device: Device, tree: Octree, precision: str, sections: Mapping[str, Any]) -> Any:
    scene = parse_scene(
        {
            "name": "check",
            "domain": {"edge_m": _EDGE_M, "leaf_edge_m": _EDGE_M / (_CELLS - 0.1)},
            "spray": {"model": "none"},
            "camera": _CAMERA | sections.get("camera", {}),
            "background": {"radius_m": 0.03},
            "patches": sections.get("patches", []),
            "transport": {**_TRANSPORT, "precision": precision, **sections.get("transport", {})},
        }
    )
    settings, phase = settings_for(scene), _phase(sections.get("phase", "isotropic"))
    # A work-item on a CPU takes eight paths at a time.
    samples = sections.get("samples", 128) * (8 if device.is_cpu else 1)
    tuning = replace(settings.tuning, first_samples=samples, iterations=60)
    tuning = replace(tuning, audit_samples_least=_PATHS, audit_samples_most=_PATHS)
    traced = trace(tree, scene, device, replace(settings, phase=phase, tuning=tuning))
    return np.concatenate([image.reshape(-1) for image in traced.weights.images.values()])


def _spray(device: Device) -> None:
    spec = LagrangianSpray(
        time_s=6e-5,
        injected_mass_kg=1e-6,
        injection_duration_s=1e-4,
        box=FlowBox(spacing_m=4e-3),
    )
    simulate_spray(spec, device, cache=default_cache())


def _droplets(device: Device, model: str) -> None:
    real = np.float64 if device.info.float64 else np.float32
    folder = default_cache()
    fuel, gas = fuel_table("n-heptane", cache=folder), gas_table("nitrogen", cache=folder)
    x = np.linspace(0.0, 1.0, 16)
    drop = Drop(
        diameter_m=(2 + 40 * x) * 1e-6,
        temperature_K=300 + 60 * x,
        gas_temperature_K=600 - 200 * x,
        pressure_Pa=1e5 + 5e5 * x,
        vapour=0.2 * x,
        slip_m_s=100 * (1 - x),
    )
    velocity_m_s = np.stack([100 * x, 50 - 30 * x, 10 * x], axis=1)
    mass_kg = fuel.mass_kg(drop.diameter_m, drop.temperature_K)
    states = DropletStates(mass_kg, drop.temperature_K, velocity_m_s)
    slow = 0.1 * velocity_m_s[:, 0]
    gases = (drop.gas_temperature_K, drop.pressure_Pa, drop.vapour, 0.1 * velocity_m_s)
    kernels = DropletKernels.of(device, fuel, gas, MODELS[model], real=real)
    rates(drop, kernels)
    kernels.run("films", drop.columns(), 11, share=1 / 3)
    advance(states, DropletSurroundings(*gases), 2e-4, kernels)
    thrice = DropletSurroundings(*(np.stack([quantity] * 3) for quantity in (*gases[:3], slow)))
    along = replace(states, velocity_m_s=velocity_m_s[:, :1])
    follow_droplets(along, thrice, np.array([2e-5, 4e-5, 8e-5]), kernels, tolerance=1e-3)


def problems(device: Device) -> Iterator[tuple[str, float, Problem]]:
    """Name, tolerance of deterministic kernels, and problem, for each precision of the device."""
    device_precision = "float64" if device.info.float64 else "float32"
    single = _ROUNDING["float32"]
    yield f"{device_precision} deposit", single, _deposits
    yield "float32 spray", _ROUNDING["gas"], _spray
    for model in MODELS:
        rounding = single if device_precision == "float64" else _ROUNDING["droplets"]
        yield f"{device_precision} droplets, {model}", rounding, partial(_droplets, model=model)
    tree = _medium()
    for precision in dict.fromkeys(("float32", device_precision)):
        for name, sections in _TRACES.items():
            work = partial(_trace, tree=tree, precision=precision, sections=sections)
            yield f"{precision} {name}", _ROUNDING[precision], work


def lanes(device: Device) -> str:
    """Kind of the vectors of a work-item, whose cells share an angle to the camera."""
    return "8 lanes" if device.is_cpu else "1 lane"


def check_device(
    device: Device,
    *,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = (),
) -> Check:
    """Compares the results of every kernel on a device with the reference.

    `report` is called with the name of each problem; `only` names those to solve, empty: all.
    """
    start, reference = time.perf_counter(), _reference()
    faults: list[str] = []
    kernels: set[str] = set()
    for name, rounding, problem in problems(device):
        if only and name not in only:
            continue
        if report is not None:
            report(name)
        expected = reference[name] | reference.get(f"{name}, {lanes(device)}", {})
        launches = Launches(rounding, expected)
        try:
            solve(problem, device, launches)
            missing = [key for key in expected if key not in launches.sums]
            if missing:
                faults.append(f"{name}: {missing[0]} is missing")
        except (_Differs, ClditError, cl.Error) as error:
            faults.append(f"{name}: {error}")
        kernels |= {key.rsplit(" ", 2)[0] for key in launches.sums if ".cl " in key}
    return Check(tuple(faults), len(kernels), time.perf_counter() - start)


def solve(problem: Problem, device: Device, launches: Launches) -> None:
    """Solves a problem, and adds what its kernels write to `launches`."""
    image = problem(replace(device, watch=launches).poisoned())
    if image is not None:
        launches.add("image", "of all components", image[None])


def _reference() -> dict[str, Sums]:
    return read_json(Path(__file__).with_suffix(".json"))
