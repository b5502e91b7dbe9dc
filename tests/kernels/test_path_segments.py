"""Path segments against NumPy, which integrates the cells' sources along a line numerically."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cldit.arrays import Floats
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.compilation import compiled
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.transport.angular_moments import MOMENTS

COMPONENTS, EMITTERS = 3, 1  # background, walls, droplets
SHAPE = (4, 3, 5)  # of the region, x y z
MIN_TRANSMISSION = 1e-3

# One path segment in each lane, until none is active; then the sums, and the end of each.
KERNEL = """
__kernel void segments(
    __global float *sums, __global float *ends_, __global const float *lines,
    __global const int4 *at, __global const int *beside, __global const float *depth,
    __global const float *cells, __global const float *light, __global const float *whole)
{
    const ThickRegion region = {0, at, beside, depth, cells, light, 0, 0, 0, 0, 2, (int4)(0),
                       (int4)(0), {(float4)(2.0f, 9.0f, 2.0f, 6.0f)}
#ifdef BLURRED_BOUNDARY
                       , whole
#endif
                       };
    float sum[PARTS];
    PendingScores pending;
    pending.count = 0;
    for (int c = 0; c < PARTS; ++c) sum[c] = pending.sum[c] = 0.0f;
    Segments f = no_segments();
    for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
        __global const float *l = lines + 9 * (get_global_id(0) * SIMD_WIDTH + lane);
        const float3 from = (float3)(l[1], l[2], l[3]), direction = (float3)(l[4], l[5], l[6]);
        start_segment(&f, lane, (int)l[0], from, direction, l[7], CUTOFF, l[8]);
    }
    while (any_of(f.active)) {
        const SegmentEnd e = cross_cell(sum, &pending, &f, &region);
        for (int lane = 0; lane < SIMD_WIDTH; ++lane) {
            if (!LANE_I(e.ended, lane)) continue;
            LANE_I(f.active, lane) = 0;
            end_segment(sum, &pending, &f, lane, &e, lane % 2, &region);
            __global float *end = ends_ + 5 * (get_global_id(0) * SIMD_WIDTH + lane);
            const int drawn = LANE_I(f.drawn, lane);
            end[0] = LANE(f.scattered, lane);
            end[1] = drawn;
            const float depth_there = drawn < 0 ? 1.0f : -depth[drawn];
            const float on = length_at(LANE(f.u, lane), LANE(f.share, lane), depth_there);
            end[2] = LANE(f.x, lane) + on * f.direction[lane].x;
            end[3] = LANE(f.y, lane) + on * f.direction[lane].y;
            end[4] = LANE(f.z, lane) + on * f.direction[lane].z;
        }
    }
    flush_scores(&pending);
    for (int c = 0; c < PARTS; ++c) sums[get_global_id(0) * PARTS + c] = sum[c] + pending.sum[c];
}
"""


def _moments(d: Floats) -> Floats:
    x, y, z = d
    return np.array([1.0, x, y, z, x * x - z * z, y * y - z * z, x * y, x * z, y * z])


class _Region:
    """Random cells, in some of which paths go on. The sides at x = 0 and x = 4 are the boundary; at
    the others segments end in stored radiance."""

    def __init__(
        self, rng: np.random.Generator, planes: int, *, linear: bool, blurred: bool = False
    ) -> None:
        nx, ny, nz = SHAPE
        self.at = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), -1).reshape(-1, 3)
        count = len(self.at)
        number = np.full((nx + 2, ny + 2, nz + 2), -1)
        number[1:-1, 1:-1, 1:-1] = np.arange(count).reshape(SHAPE)
        self.beside = np.full((count, 6), -1, np.int32)
        self.interfaces = 0
        for cell, at in enumerate(self.at):
            for side in range(6):
                there = at + 1
                there[side // 2] += 2 * (side % 2) - 1
                next_ = number[tuple(there)]
                if next_ < 0 and side >= 2:
                    next_ = -2 - self.interfaces
                    self.interfaces += 1
                self.beside[cell, side] = next_
        self.depth = rng.choice([0.0, 1e-3, 0.3, 2.0], count)
        self.albedo = np.where(rng.random(count) < 0.3, 0.6, 0.0)
        self.emission = rng.random((count, COMPONENTS))
        self.emission[:, : COMPONENTS - EMITTERS] = 0.0
        self.source = rng.random((count, planes, COMPONENTS))
        self.gradient = rng.normal(size=(count, 3, COMPONENTS)) * linear
        self.light = rng.random((self.interfaces, 2, COMPONENTS))
        self.excess = rng.uniform(-1, 1, (self.interfaces, 2)) * blurred
        self.whole = self.depth * rng.uniform(1, 2, count)
        fours = np.zeros((count, 1 + planes + 3 * linear, 4))
        fours[:, 0, :COMPONENTS] = self.emission
        fours[:, 1 : 1 + planes, :COMPONENTS] = self.source
        if linear:
            fours[:, 1 + planes :, :COMPONENTS] = self.gradient
        head = np.column_stack([self.depth, self.albedo, self.depth * 0, self.depth * 0])
        self.records = np.column_stack([head, fours.reshape(count, -1)])

    def trace(self, line: Floats, lane: int) -> tuple[Floats, float, list[Any]]:
        """Score of one segment; weight scattered where paths go on; crossings of such cells."""
        cell, p, d, weight = int(line[0]), line[1:4].copy(), line[4:7], line[7]
        light = np.zeros(COMPONENTS + 1)
        left, scattered, crossings = weight, 0.0, []
        unscattered = weight
        to_discrete = _moments(d)[: self.source.shape[1]]
        while True:
            far = np.where(d > 0, 1 - p, p)
            with np.errstate(divide="ignore", invalid="ignore"):
                to = np.where(d == 0, np.inf, far / np.abs(d))
            length, axis = to.min(), int(np.argmin(to))
            kappa = self.depth[cell]
            taken = left * -np.expm1(-kappa * length)
            unscattered *= np.exp(-self.whole[cell] * length)
            last = left - taken <= MIN_TRANSMISSION * weight
            if self.albedo[cell] > 0:
                taken = left if last else taken
                light[:COMPONENTS] += taken * self.emission[cell]
                light[COMPONENTS] += taken * (1 - self.albedo[cell])
                scattered += taken * self.albedo[cell]
                crossings.append((cell, p.copy(), length))
            elif kappa > 0:
                s, w = np.polynomial.legendre.leggauss(40)
                s, w = length * (s + 1) / 2, length * w / 2
                w = left * kappa * np.exp(-kappa * s) * w
                off = p + s[:, None] * d - 0.5
                seen = to_discrete @ self.source[cell] * w.sum() + w @ (off @ self.gradient[cell])
                if last:  # the rest of the weight gets the source in the cell's middle
                    seen += (left - taken) * (to_discrete @ self.source[cell])
                    # and the gradient at the middle of the segment
                    seen += ((left - taken) * (p + length / 2 * d - 0.5)) @ self.gradient[cell]
                light[:COMPONENTS] += seen
                light[COMPONENTS] += (left if last else taken) - seen[: COMPONENTS - EMITTERS].sum()
            if last:
                return light, scattered, crossings
            left -= taken
            p = np.clip(p + length * d, 0.0, 1.0)
            up = int(d[axis] > 0)
            next_ = self.beside[cell, 2 * axis + up]
            if next_ <= -2:
                stored = self.light[-2 - next_, lane % 2]
                light[:COMPONENTS] += left * stored
                light[COMPONENTS] += left * (1 - stored[: COMPONENTS - EMITTERS].sum())
                excess = unscattered * self.excess[-2 - next_, lane % 2]
                light[:2] += excess, -excess
                return light, scattered, crossings
            if next_ == -1:
                place = self.at[cell] + p
                reach = (9.0 - place[1]) / d[1] if d[1] > 0 else -1.0
                on = place + reach * d - np.array([2.0, 9.0, 2.0])
                light[int(not (reach > 0 and on[0] ** 2 + on[2] ** 2 <= 6.0))] += left
                return light, scattered, crossings
            p[axis], cell = 1.0 - up, next_


def _traced(
    device: Device,
    region: _Region,
    lines: Floats,
    *,
    vector: int,
    cutoff: float,
    flags: Sequence[str],
) -> tuple[Floats, Floats]:
    """Sums (N / vector, C + 1); weight scattered, and where, of each segment (N, 5)."""
    count = len(lines)
    defines = "".join(f"#define {flag} 1\n" for flag in ("EMITTERS", *flags))
    defines += f"#define PENDING_READS 3\n#define SIMD_WIDTH {vector}\n#define CUTOFF {cutoff}f\n"
    light = region.light
    if "BLURRED_BOUNDARY" in flags:  # the background's excess behind the components
        light = np.concatenate([light, region.excess[..., None]], axis=2)
    source = f"{defines}\n{assemble('simd.h')}\n{assemble('path_segment.h')}\n{KERNEL}"
    program = compiled(device, source).program
    depth = region.records[:, 0] * np.where(region.records[:, 1] > 0, -1, 1)
    sums = zeros(device, "sums", count // vector * (COMPONENTS + 1), np.float32)
    ends = zeros(device, "ends", count * 5, np.float32)
    at = np.column_stack([region.at, np.zeros(len(region.at), int)]).astype(np.int32)
    cl.Kernel(program, "segments")(
        device.queue,
        (count // vector,),
        None,
        sums,
        ends,
        upload(device, "lines", lines.astype(np.float32)),
        upload(device, "at", at),
        upload(device, "beside", region.beside),
        upload(device, "depth", depth.astype(np.float32)),
        upload(device, "cells", region.records.astype(np.float32)),
        upload(device, "light", light.astype(np.float32)),
        upload(device, "whole depth", region.whole.astype(np.float32)),
    )
    got = download(device, sums, np.empty((count // vector, COMPONENTS + 1), np.float32))
    ended = download(device, ends, np.empty((count, 5), np.float32))
    return got.astype(float), ended.astype(float)


@pytest.mark.parametrize(
    ("flags", "vector"),
    [
        ((), 1),
        (("LINEAR_SOURCE",), 8),
        (("MOMENT_SOURCE", "LINEAR_SOURCE"), 1),
        (("MOMENT_SOURCE", "BLURRED_BOUNDARY"), 8),
    ],
)
def test_path_segments(device: Device, flags: tuple[str, ...], vector: int) -> None:
    """Scores and scattered weight to single precision; the sum of weights is conserved."""
    rng = np.random.default_rng(4)
    region = _Region(
        rng,
        MOMENTS if "MOMENT_SOURCE" in flags else 1,
        linear="LINEAR_SOURCE" in flags,
        blurred="BLURRED_BOUNDARY" in flags,
    )
    count = 64
    d = rng.normal(size=(count, 3))
    d[:3] = np.eye(3)
    d[3:6] = -np.eye(3)
    d[6, 0] = 0.0
    d /= np.linalg.norm(d, axis=1)[:, None]
    cells = rng.integers(0, len(region.at), count)
    lines = np.column_stack([cells, rng.random((count, 3)), d, rng.random((count, 2))])
    lines = lines.astype(np.float32).astype(float)
    got, ended = _traced(device, region, lines, vector=vector, cutoff=MIN_TRANSMISSION, flags=flags)
    wanted = np.zeros((count, COMPONENTS + 1))
    for k, line in enumerate(lines):
        wanted[k], scattered, crossings = region.trace(line, k % vector)
        assert ended[k, 0] == pytest.approx(scattered, abs=2e-6)
        assert (ended[k, 1] >= 0) == (scattered > 0)
        if scattered > 0:
            p, length = next(one[1:] for one in crossings if one[0] == int(ended[k, 1]))
            on = (ended[k, 2:] - p) @ line[4:7]  # within that cell
            np.testing.assert_allclose(ended[k, 2:], p + on * line[4:7], atol=2e-6)
            assert -1e-6 <= on <= length + 1e-6
    # A dozen cells, each to some 1e-6 of the weights, which are below 1.
    summed = wanted.reshape(count // vector, vector, -1).sum(axis=1)
    np.testing.assert_allclose(got, summed, atol=3e-6 * vector)
    outside = got[:, : COMPONENTS - EMITTERS].sum(axis=1)
    goes_on = ended[:, 0].reshape(-1, vector).sum(axis=1)
    began = lines[:, 7].reshape(-1, vector).sum(axis=1)
    np.testing.assert_allclose(outside + got[:, COMPONENTS] + goes_on, began, atol=2e-6 * vector)


def test_places_are_drawn_by_what_they_scatter(device: Device) -> None:
    """Uniform random numbers give places that are uniform in the scattered share up to them."""
    count = 512
    region = _Region(np.random.default_rng(6), 1, linear=False)
    region.records[:, :2] = 0.4, 0.7
    d = np.array([0.1, 0.2, 0.97])
    d /= np.linalg.norm(d)
    lines = np.tile([0, 0.2, 0.2, 0.1, *d, 1.0, 0.0], (count, 1))
    lines[:, 8] = (np.arange(count) + 0.5) / count
    ended = _traced(device, region, lines, vector=8, cutoff=1e-6, flags=())[1]
    place = region.at[ended[:, 1].astype(int)] + ended[:, 2:]
    along = (place - lines[0, 1:4]) @ d
    far = min((SHAPE[k] - lines[0, 1 + k]) / d[k] for k in range(3))
    share = np.sort(-np.expm1(-0.4 * along)) / -np.expm1(-0.4 * far)
    # Each of some six cells has one more chance or less than its part of 512.
    np.testing.assert_allclose(share, lines[:, 8], atol=6 / count)
