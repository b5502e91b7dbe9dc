"""Roofline: kernel times and the least that memory and arithmetic of this device allow.

After Williams, Waterman and Patterson, Comm. ACM 52 (2009).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.bench.case import Cost
from cldit.bench.report import Part, Table, number
from cldit.gpu.buffers import zeros
from cldit.gpu.compilation import compiled
from tests.bench.case import Case
from tests.bench.kernels import Kernels, quickest
from tests.bench.page import UNLISTED, write_measured

_COPY_BYTES = 256 * 2**20  # several times any cache
_LANES = 2**15
_ROUNDS = 512
_SUMS = 8  # of multiply_add
_REAL_BYTES = 4

# Operations of the kernels, counted in their source; a multiplication and an addition are two, a
# division, a root or a comparison one.
STEPS = 1.85  # of a ray in a layer: sum of |components| over the largest, mean over the sphere
SWEEP_CELL = 34  # stretch, decay, absorbed, mean_transmission: all branches, as vectors take them
SWEEP_COMPONENT = 5  # gap, two multiplications and additions
IMAGE_STEP = 30  # walk_ahead: sides, and distances to them; walk_on: six bounds; index sums
IMAGE_CELL = 10  # absorbed and what is still transmitted
IMAGE_SOURCE = 2
SEGMENT_STEP = 15  # the nearest side, what lies beside it, and on
SEGMENT_CELL = 55  # decay, absorbed, mean_transmission, rising; where it is seen, along three axes
SEGMENT_SOURCE = 8  # of a component: S_0 and three changes, each times what counts of it
_SEGMENTS = 64  # of a pixel


@dataclass(frozen=True)
class Machine:
    """What the device reaches at most, for each core second that it takes.

    bytes_per_s: read and written by a copy. flops_per_s: additions and multiplications in single
    precision. exps_per_s: exponentials.
    """

    bytes_per_s: float
    flops_per_s: float
    exps_per_s: float

    @classmethod
    def of(cls, case: Case) -> Machine:
        """Measures the device of a case."""
        device = case.device
        vector = 8 if device.is_cpu else 1
        source = Path(__file__).with_suffix(".cl").read_text(encoding="utf-8")
        program = compiled(device, source, [f"-DSIMD_WIDTH={vector}"]).program
        count = min(_COPY_BYTES, device.info.largest_buffer_bytes // 2) // _REAL_BYTES
        count -= count % (64 * vector)
        target, origin = (zeros(device, "copy", count, np.float32) for _ in range(2))

        def cost(name: str, lanes: int, *rounds: int) -> Cost:
            kernel = cl.Kernel(program, name)
            kernel.set_args(target, origin, *map(np.int32, rounds))
            queue = device.queue
            return quickest(case, lambda: cl.enqueue_nd_range_kernel(queue, kernel, (lanes,), None))

        lanes = _LANES if device.is_cpu else 32 * _LANES
        copied = cost("copy", count // vector)
        summed = cost("multiply_add", lanes, _ROUNDS)
        raised = cost("exponentials", lanes, _ROUNDS)
        work = lanes * vector * _ROUNDS
        return cls(
            bytes_per_s=2 * _REAL_BYTES * count / copied.core_s,
            flops_per_s=2 * _SUMS * work / summed.core_s,
            exps_per_s=2 * work / raised.core_s,
        )


@dataclass(frozen=True)
class Line:
    """One kernel: what it must move and compute, the least time for that, and what it takes."""

    kernel: str
    work: str
    bytes: float
    flops: float
    exps: float
    roofline_s: float
    core_s: float

    @classmethod
    def of(
        cls,
        machine: Machine,
        kernel: str,
        work: str,
        core_s: float,
        *,
        moved: float,
        flops: float,
        exps: float,
    ) -> Line:
        """Works out the roofline of one kernel."""
        arithmetic = flops / machine.flops_per_s + exps / machine.exps_per_s
        roofline_s = max(moved / machine.bytes_per_s, arithmetic)
        return cls(kernel, work, moved, flops, exps, roofline_s, core_s)


def roofline(case: Case, *, directions: int = 96) -> Part:
    """Sweep and path segments, with and without vectors; image kernel, and its traversal alone."""
    machine = Machine.of(case)
    kernels = Kernels(case)
    lines = []
    if kernels.cells.needs.scattering:
        lines += _sweeps(machine, kernels, directions)
    lines += _images(machine, kernels)
    lines += _segments(machine, kernels)
    table = Table.of(
        ("kernel", "work", "GB", "Gflop", "Gexp", "roofline, core-s", "taken, core-s", "times"),
        [
            (
                line.kernel,
                line.work,
                number(line.bytes / 1e9),
                number(line.flops / 1e9),
                number(line.exps / 1e9),
                number(line.roofline_s),
                number(line.core_s),
                number(line.core_s / line.roofline_s, 2),
            )
            for line in lines
        ],
    )
    return Part(
        name="roofline",
        title=f"Kernels against the roofline: {case.scene.name}",
        tables=(table,),
        data={"machine": asdict(machine), "lines": [asdict(line) for line in lines]},
        text=(
            f"Per core second, measured in the same run: {machine.bytes_per_s / 1e9:.1f} GB "
            f"copied (read and written), {machine.flops_per_s / 1e9:.1f} Gflop in single "
            f"precision, {machine.exps_per_s / 1e9:.2f} G exponentials. The roofline is the larger "
            "of the times of the counted bytes and of the counted operations.",
            "- **Sweep.** Every step of a direction looks up the position of its rays for each "
            "row, however short. Rays move from cell to cell, so they are not contiguous vectors. "
            "Filling the source and collecting the residual are included.\n"
            "- **Image.** Each step depends on the one before (next cell, its brick, its depth), "
            "so it waits for dependent loads, not for bandwidth. Neighbouring pixels branch "
            "differently, so it is not vectorised. The traversal alone takes most of the time.\n"
            "- **Path segments.** Eight cells at once wait for loads from eight places, and their "
            "results are combined one by one.",
        ),
    )


def _sweeps(machine: Machine, kernels: Kernels, directions: int) -> list[Line]:
    cells = kernels.cells
    box = cells.box()
    components = len(cells.needs.components)
    scatters = np.zeros(len(cells.depth), np.bool_)
    scatters[cells.address] = True

    def wide(some: NDArray[np.bool_]) -> int:
        """Cells of the groups along x that hold any."""
        dense = cells.dense(box, some)
        dense = np.pad(dense, ((0, 0), (0, 0), (0, -dense.shape[2] % 8)))
        groups = dense.reshape(*dense.shape[:2], -1, 8)
        return 8 * int(groups.any(axis=3).sum())

    lit, computed = wide(scatters), wide(cells.depth > 0)
    emitters = len(cells.needs.emitters)
    # For all directions of a quadrant of an axis (at most 32 of an axis together): depth, S, and D
    # read and written, of cells in groups that scatter; elsewhere depth and S of what is emitted.
    # Not the rays, which stay in the cache.
    segments = directions * STEPS
    cells_once = (1 + 3 * components) * lit + (1 + emitters) * (computed - lit)
    moved = 3 * 4 * _REAL_BYTES * cells_once
    flops = segments * (computed * SWEEP_CELL + SWEEP_COMPONENT * components * computed)
    work = f"{directions} directions, {box.cells / 1e6:.2f} M cells, {computed / 1e6:.2f} M filled"
    lines = []
    for vector in (None, 1):
        if vector == 1 and not kernels.case.device.is_cpu:
            continue
        cost = kernels.sweep(directions, vector=vector)
        name = "sweep" if vector is None else "sweep, one cell at a time"
        lines.append(Line.of(machine, name, work, cost.core_s, moved=moved, flops=flops, exps=0.0))
    return lines


def _images(machine: Machine, kernels: Kernels) -> list[Line]:
    steps, traversal = kernels.steps()
    needs = kernels.cells.needs
    sources = len(needs.components) - (0 if needs.scattering else 2)
    total, through = (float(count.sum()) for count in steps)
    pixels = steps[0].size
    out = _REAL_BYTES * pixels * len(needs.components)
    # Per step: the brick's entry and the record's number; through something also the record: depth,
    # sources and, with scattering, what is emitted at radiance 1.
    record = 1 + sources + (1 if needs.scattering else 0)
    walked = 2 * _REAL_BYTES * total
    work = f"{pixels / 1e6:.2f} M pixels, {total / 1e6:.0f} M steps, {through / 1e6:.0f} M filled"
    image = Line.of(
        machine,
        "image",
        work,
        kernels.image().core_s,
        moved=walked + _REAL_BYTES * record * through + out,
        flops=IMAGE_STEP * total + (IMAGE_CELL + IMAGE_SOURCE * sources) * through,
        exps=through,
    )
    lines = [image]
    if needs.scattering:
        # Changes are of droplets' cells alone, and are not counted.
        trace = Line.of(
            machine,
            "image, as traces make it",
            work + ", two images, sources linear in cells",
            kernels.image(images=2, linear=True).core_s,
            moved=walked + _REAL_BYTES * (record + sources) * through + 2 * out,
            flops=IMAGE_STEP * total + (IMAGE_CELL + 2 * IMAGE_SOURCE * sources) * through,
            exps=through,
        )
        lines.append(trace)
    alone = Line.of(
        machine,
        "image, its traversal alone",
        work,
        traversal.core_s,
        moved=walked + 2 * _REAL_BYTES * pixels,
        flops=IMAGE_STEP * total,
        exps=0.0,
    )
    return [*lines, alone]


def _segments(machine: Machine, kernels: Kernels) -> list[Line]:
    found, alone = kernels.path_segments(_SEGMENTS), kernels.path_segments(_SEGMENTS, vector=1)
    if found is None or alone is None:
        return []
    components = len(kernels.cells.needs.components)
    # Each record is read once, and the radiance at each end; all else stays in the cache.
    moved = _REAL_BYTES * (found.region * found.record + found.segments * components)
    cell = SEGMENT_STEP + SEGMENT_CELL + SEGMENT_SOURCE * components
    return [
        Line.of(
            machine,
            name,
            f"{each.pixels} pixels, {each.segments / 1e6:.2f} M path segments through "
            f"{each.crossed / each.segments:.1f} cells each",
            each.cost.core_s,
            moved=moved,
            flops=cell * each.crossed,
            exps=0.0,
        )
        for name, each in (("path segments", found), ("path segments, one at a time", alone))
    ]


def main() -> None:
    """Writes roofline.md."""
    write_measured(lambda given: roofline(given.case()), folder=UNLISTED)
