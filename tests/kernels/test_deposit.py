"""Deposition of clouds against a direct calculation, one cell after the other, in Python."""

from __future__ import annotations

from dataclasses import replace
from math import floor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit import arrays
from cldit.arrays import Floats
from cldit.gpu.buffers import upload
from cldit.gpu.device import Device
from cldit.medium import corners, rasterise
from cldit.medium.deposit import Directory, PlacedBoxes, place_boxes, touched_bricks
from cldit.medium.frame import BRICK, Cube
from cldit.medium.rasterise import REACH, BoxRasteriser, CloudRasteriser

CELLS = 24  # three bricks
LEAST = 1e-8  # variance of a point, in cells squared


def _part(low: float, high: float) -> tuple[float, float, float]:
    """Share of a profile of unit variance in an interval, and its mean and variance there."""
    u, v = max(low / REACH, -1.0), min(high / REACH, 1.0)
    if v <= u:
        return 0.0, 0.0, 0.0
    share = first = second = 0.0
    for begin, end, sign in ((u, min(v, 0.0), 1), (max(u, 0.0), v, -1)):
        if end > begin:
            share += (end - begin) + sign * (end**2 - begin**2) / 2
            first += (end**2 - begin**2) / 2 + sign * (end**3 - begin**3) / 3
            second += (end**3 - begin**3) / 3 + sign * (end**4 - begin**4) / 4
    if share <= 1e-12:
        return max(share, 0.0), (u + v) / 2 * REACH, 0.0
    mean = first / share
    return share, mean * REACH, max(second / share - mean * mean, 0.0) * REACH**2


def _intervals(middle: float, sigma: float) -> list[tuple[int, float, float, float]]:
    """Cells of a profile, each with its part: share, mean and variance of the whole profile."""
    first, last = floor(middle - REACH * sigma), floor(middle + REACH * sigma)
    parts = [(at, *_part((at - middle) / sigma, (at + 1 - middle) / sigma))
             for at in range(first, last + 1)]  # fmt: skip
    if first == last:
        parts = [(first, *_part(-REACH, REACH))]
    return [(at, share, mean * sigma, within * sigma**2) for at, share, mean, within in parts]


def expected(place: Floats, covariance: Floats, amount: Floats) -> Floats:
    """Amounts (A, z, y, x) of clouds in all cells."""
    found = np.zeros((amount.shape[1], CELLS, CELLS, CELLS))
    for (px, py, pz), cov, own in zip(place, covariance, amount, strict=True):
        xx, yy, zz = np.diag(cov) + LEAST
        zx, zy, yx = cov[2, 0], cov[2, 1], cov[1, 0]
        on_z, on_z_x = zy / zz, zx / zz
        rest_y = max(yy - on_z * zy, LEAST)
        on_y_x = (yx - on_z * zx) / rest_y
        rest_x = max(xx - on_z_x * zx - on_y_x**2 * rest_y, LEAST)
        for z, share_z, mean_z, within_z in _intervals(pz, zz**0.5):
            var_y = rest_y + on_z**2 * within_z
            if share_z <= 0:
                continue
            for y, share_y, mean_y, within_y in _intervals(py + on_z * mean_z, var_y**0.5):
                if share_y <= 0:
                    continue
                gain_z, gain_y = on_z * within_z / var_y, rest_y / var_y
                shift = on_z_x * (mean_z + gain_z * mean_y) + on_y_x * gain_y * mean_y
                slope = on_z_x * gain_z + on_y_x * gain_y
                known = on_z_x**2 * within_z + on_y_x**2 * rest_y
                var_x = rest_x + max(known - slope**2 * (var_y - within_y), 0.0)
                for x, share_x, *_ in _intervals(px + shift, var_x**0.5):
                    at = tuple(np.clip([z, y, x], 0, CELLS - 1))
                    found[(slice(None), *at)] += share_z * share_y * share_x * own
    return found


def clouds(count: int) -> tuple[Floats, Floats, Floats]:
    """Clouds of all shapes, from points to needles and plates of 8 cells, some beyond the cube."""
    rng = np.random.default_rng(3)
    place = rng.uniform(-0.5, CELLS + 0.5, (count, 3))
    sides = rng.normal(size=(count, 3, 3)) * 10 ** rng.uniform(-3, 0.4, (count, 1, 3))
    covariance = sides @ sides.transpose(0, 2, 1)
    place[:2], covariance[:2] = [[5.0, 6.0, 7.0], [8.5, 8.5, 8.5]], 0.0
    amount = 10.0 ** rng.uniform([-20, 18], [-15, 22], (count, 2))
    return place, covariance, amount


def deposited(device: Device, place: Floats, covariance: Floats, amount: Floats) -> Floats:
    """Amounts (A, z, y, x) by the kernels; bricks that are not marked are empty."""
    made = CloudRasteriser.of(device, place, covariance, CELLS)
    mark = np.zeros((CELLS // BRICK,) * 3, bool)
    made.mark(mark)
    directory = np.full(mark.shape, -1, np.int32)
    directory[mark] = np.arange(mark.sum())
    sums = [np.zeros(int(mark.sum()) * BRICK**3) for _ in amount.T]
    made.add(directory, list(amount.T), sums)
    blocks = np.zeros((len(sums), *mark.shape, BRICK, BRICK, BRICK))
    blocks[:, mark] = np.reshape(sums, (len(sums), -1, BRICK, BRICK, BRICK))
    return np.asarray(blocks.transpose(0, 1, 4, 2, 5, 3, 6).reshape(len(sums), *[CELLS] * 3))


def _as(device: Device, kind: str, *, float64: bool) -> Device:
    return replace(device, info=replace(device.info, kind=kind, float64=float64))


@pytest.mark.parametrize("words", [False, True], ids=["64 bits", "two words"])
@pytest.mark.parametrize("kind", ["cpu", "gpu"])
def test_clouds_in_double_precision(
    device: Device, kind: str, words: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Layer by layer and with atomic additions: within 1e-11 of the largest cell. Shares of 1e-12
    of a profile have means and variances with rounding errors of 1e-4, 1e-16 of the cloud, which
    is amplified by the slopes; the largest cell has at least 1e-2 of the largest cloud."""
    if not device.info.float64:
        pytest.skip("the device has no double precision")
    if words:
        monkeypatch.setattr(rasterise, "fixed_point_defines", lambda _: {"FIXED_POINT_WORDS": 1})
    place, covariance, amount = clouds(150)
    found = deposited(_as(device, kind, float64=True), place, covariance, amount)
    wanted = expected(place, covariance, amount)
    for got, right, own in zip(found, wanted, amount.T, strict=True):
        np.testing.assert_allclose(got, right, rtol=0, atol=1e-11 * right.max())
        assert got.sum() == pytest.approx(own.sum(), rel=1e-13)
        assert got.min() >= 0


@pytest.mark.parametrize("kind", ["cpu", "gpu"])
def test_clouds_in_single_precision(device: Device, kind: str) -> None:
    """A share s of a profile has a mean with an error of some eps / s of its width, which moves s
    of the cloud: by some eps of it in each of up to 25 cells in a row, times slopes of up to 4."""
    place, covariance, amount = clouds(150)
    found = deposited(_as(device, kind, float64=False), place, covariance, amount)
    wanted = expected(place, covariance, amount)
    eps = float(np.finfo(np.float32).eps)
    for got, right, own in zip(found, wanted, amount.T, strict=True):
        np.testing.assert_allclose(got, right, rtol=0, atol=100 * eps * own.max())
        assert got.sum() == pytest.approx(own.sum(), rel=20 * eps)
        assert got.min() >= 0


def test_parts_make_the_whole(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bits do not depend on the parts in which clouds and kinds are added, nor on their order."""
    place, covariance, amount = clouds(60)
    whole = deposited(device, place, covariance, amount)
    monkeypatch.setattr(rasterise, "AT_ONCE", 40)
    monkeypatch.setattr(rasterise, "_SUM_BYTES", 1)
    monkeypatch.setattr(rasterise, "_SUMS_AT_ONCE", 1000)
    turned = np.random.default_rng(1).permutation(60)
    parts = deposited(device, place[turned], covariance[turned], amount[turned])
    np.testing.assert_array_equal(parts, whole)


@pytest.mark.parametrize("parts", [False, True])
def test_boxes_are_those_of_the_twin(
    device: Device, parts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Boxes within a cell, across bricks, over the whole cube, and with faces on those of cells.

    Both have the same corners, rounded to 2^-31 of the cube, and the same shares of them."""
    if parts:
        monkeypatch.setattr(corners, "AT_ONCE", 50)
        monkeypatch.setattr(rasterise, "_LANES", 150)
    frame = Cube((-1.0, 2.0, 0.5), 3.2, 5)
    rng = np.random.default_rng(5)
    lower = rng.uniform(0.0, frame.cells - 1.0, (400, 3))
    lower[:100] = np.floor(lower[:100])
    upper = np.minimum(lower + np.exp(rng.uniform(-3.0, 3.0, (400, 3))), frame.cells)
    upper[:50] = np.ceil(upper[:50])
    lower[0], upper[0] = 0.0, frame.cells
    lower_m, upper_m = (frame.lower_m + corner * frame.cell_m for corner in (lower, upper))
    amounts = [rng.uniform(0.0, 1.0, 400), rng.uniform(-1e6, 1e6, 400)]
    sums: list[list[Floats]] = []
    marks: list[Directory] = []
    for chosen in (None, device):
        boxes = place_boxes(frame, lower_m, upper_m, content="gas", device=chosen)
        assert isinstance(boxes, PlacedBoxes if chosen is None else BoxRasteriser)
        marks.append(touched_bricks(frame, [boxes], limit=10**9))
        sums.append([np.zeros(np.count_nonzero(marks[-1] >= 0) * BRICK**3) for _ in amounts])
        boxes.add(marks[-1], amounts, sums[-1])
    np.testing.assert_array_equal(marks[0], marks[1])
    resolution = 1e-12 if device.info.float64 else 1e-5
    for expected_sum, found, amount in zip(*sums, amounts, strict=True):
        np.testing.assert_allclose(found, expected_sum, atol=resolution * np.abs(amount).sum())
        assert found.sum() == pytest.approx(amount.sum(), rel=100 * resolution)


def test_boxes_stay_on_the_device(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Corners are converted and uploaded once for all depths, as long as their arrays exist."""
    uploaded: list[int] = []

    def counted(device: Device, label: str, array: NDArray[Any]) -> Any:
        uploaded.append(array.nbytes)
        return upload(device, label, array)

    monkeypatch.setattr(corners, "upload", counted)
    frame = Cube((0.0, 0.0, 0.0), 1.0, 0)
    lower_m = np.random.default_rng(2).uniform(0.0, 0.9, (30, 3))
    upper_m = lower_m + 0.1
    before = len(arrays._KEPT)
    for depth in (4, 5, 6, 4):
        placed = place_boxes(frame.at(depth), lower_m, upper_m, content="gas", device=device)
        touched_bricks(frame.at(depth), [placed], limit=10**9)
    assert uploaded == [30 * 6 * 4]
    assert len(arrays._KEPT) == before + 1
    del lower_m, placed
    assert len(arrays._KEPT) == before
