"""Grid files: what comes out is what was written, and what cannot be is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.scene.spray import GridSpray
from cldit.spray.grid import read_grid
from cldit.spray.result import Cells

ORIGIN = np.array([-1e-3, 0.0, 2e-3])
SPACING = np.array([0.5e-3, 1e-3, 2e-3])
FRAME = {"origin_m": ORIGIN, "spacing_m": SPACING}


def spec(folder: Path, **arrays: Any) -> GridSpray:
    np.savez(folder / "grid.npz", **arrays)
    return GridSpray(file=folder / "grid.npz")


def test_voxels_lie_where_their_index_says(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    names = ["vapour_absorption_per_m", "droplet_absorption_per_m", "droplet_scattering_per_m"]
    arrays = {name: random.uniform(0.1, 9.0, (3, 4, 5)) for name in names}
    empty = random.random((3, 4, 5)) < 0.4
    for values in arrays.values():
        values[empty] = 0.0
    for name in ("vapour_temperature_K", "droplet_temperature_K"):
        arrays[name] = random.uniform(300.0, 600.0, (3, 4, 5))
    spray = read_grid(spec(tmp_path, **FRAME, **arrays))

    given = spray.prescribed
    assert given is not None
    assert (
        len(given.vapour_temperature_K) == np.count_nonzero(~empty) == spray.notes["voxels_filled"]
    )
    assert spray.notes["voxels"] == 60
    middle = (given.cells.lower_m + given.cells.upper_m) / 2
    i, j, k = np.floor((middle - ORIGIN) / SPACING).astype(int).T
    for name, values in arrays.items():
        assert np.array_equal(getattr(given, name), values[i, j, k])
    # the voxels are all of one size: rounding of a coordinate of 1e-2 m against an edge of 5e-4 m
    assert given.cells.volume_m3 == pytest.approx(np.prod(SPACING), rel=1e-14)


def test_neighbours_share_their_face_to_the_last_bit() -> None:
    cells = Cells.regular(origin_m=np.array([0.1, 0.2, 0.3]), spacing_m=SPACING, shape=(7, 1, 1))
    assert np.array_equal(cells.upper_m[:-1, 0], cells.lower_m[1:, 0])


def test_one_voxel_of_integers(tmp_path: Path) -> None:
    spray = read_grid(spec(tmp_path, **FRAME, droplet_scattering_per_m=np.full((1, 1, 1), 12)))
    assert spray.prescribed is not None
    assert spray.prescribed.droplet_scattering_per_m.tolist() == [12.0]
    assert spray.prescribed.droplet_temperature_K.tolist() == [0.0]  # nothing emits
    assert spray.prescribed.cells.upper_m == pytest.approx((ORIGIN + SPACING)[None], rel=1e-15)


def test_grid_of_zeros_has_no_cells(tmp_path: Path) -> None:
    spray = read_grid(spec(tmp_path, **FRAME, vapour_absorption_per_m=np.zeros((2, 2, 2))))
    assert spray.prescribed is not None
    assert spray.prescribed.cells.lower_m.shape == (0, 3)


def _with(value: float) -> np.ndarray[Any, Any]:
    values = np.ones((2, 3, 4))
    values[1, 0, 2] = value
    return values


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"vapor": np.ones((1, 1, 1))}, "grid.npz: unknown array vapor; allowed: origin_m"),
        ({"origin_m": None}, "grid.npz: origin_m is missing"),
        ({"spacing_m": np.array([1.0, 0.0, 1.0])}, r"spacing_m: 0 at \[1\] is outside 1e-09"),
        ({"origin_m": np.array([np.nan, 0, 0])}, r"origin_m: nan at \[0\]"),
        ({}, "no .nx, ny, nz. array; allowed: "),
        ({"vapour_absorption_per_m": np.ones((0, 1, 1))}, "each at least 1"),
        (
            {"vapour_absorption_per_m": np.ones((2, 2, 2)), "vapour_temperature_K": _with(1.0)},
            r"vapour_temperature_K: shape \(2, 3, 4\), but vapour_absorption_per_m has \(2, 2, 2\)",
        ),
        ({"droplet_absorption_per_m": _with(np.nan)}, r"nan at \[1, 0, 2\] is outside 0..1e\+12"),
        ({"droplet_absorption_per_m": _with(-1.0)}, r"-1 at \[1, 0, 2\] is outside"),
        ({"droplet_absorption_per_m": _with(1e13)}, r"1e\+13 at \[1, 0, 2\] is outside"),
        ({"vapour_temperature_K": _with(5001.0)}, r"5001 at \[1, 0, 2\] is outside 0..5000"),
        (
            {"droplet_absorption_per_m": _with(3.0), "vapour_temperature_K": _with(400.0)},
            r"grid.npz: droplet_temperature_K is missing, but droplet_absorption_per_m is up to 3;",
        ),
        ({"vapour_absorption_per_m": np.ones((1, 1, 1), complex)}, "complex128, expected real"),
        ({"vapour_absorption_per_m": np.full((1, 1, 1), None)}, "cannot be read as .npz"),
    ],
)
def test_refused(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    merged = {name: values for name, values in (FRAME | arrays).items() if values is not None}
    with pytest.raises(SprayError, match=message):
        read_grid(spec(tmp_path, **merged))


def test_files_that_are_no_npz(tmp_path: Path) -> None:
    file = tmp_path / "grid.npz"
    with pytest.raises(SprayError, match=r"grid\.npz: no such grid file"):
        read_grid(GridSpray(file=file))
    spec(tmp_path, **FRAME, vapour_absorption_per_m=np.ones((9, 9, 9)))
    whole = file.read_bytes()
    for damaged in (b"", b"text", whole[:-100], whole[:500] + b"\0" * 500 + whole[1000:]):
        file.write_bytes(damaged)
        with pytest.raises(SprayError, match=r"grid\.npz: cannot be read as \.npz"):
            read_grid(GridSpray(file=file))
    with file.open("wb") as stream:
        np.save(stream, np.ones(3))
    with pytest.raises(SprayError, match="a single array; expected"):
        read_grid(GridSpray(file=file))


def test_more_content_than_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A packed file of zeros is a thousand times smaller than its content."""
    file = tmp_path / "grid.npz"
    np.savez_compressed(file, vapour_absorption_per_m=np.zeros((200, 200, 200)))
    monkeypatch.setattr("cldit.spray.spray_file.free_bytes", lambda: 10_000_000)
    with pytest.raises(SprayError, match=r"grid\.npz: .*unpacks to 0\.064 GB; 0\.01 GB of memory"):
        read_grid(GridSpray(file=file))
