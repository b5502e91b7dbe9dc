"""Files of sprays: extent of droplets, what was computed before; penetrations by mass."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cldit.errors import SprayError
from cldit.gpu.device import open_device
from cldit.prepare.spray_factory import make_spray
from cldit.scene.spray import ConeSpray, EmptySpray, LagrangianSpray
from cldit.show.report.spray_report import liquid_mass
from cldit.spray.cache import cached_spray, times_together
from cldit.spray.extent import Box, Cloud, Extent
from cldit.spray.penetration import penetrations_m, with_figures
from cldit.spray.result import Cells, Parcels, Spray, Vapour
from cldit.spray.spray_file import read_spray, write_spray
from tests.cones import cone_spray
from tests.extras import needs


def _parcels(extent: Extent | None) -> Parcels:
    one = np.ones(3)
    return Parcels(np.arange(9.0).reshape(3, 3), 1e-5 * one, one, 300 * one, 600 * one, extent)


@pytest.mark.parametrize(
    "extent", [None, Box(np.array([1e-3, 2e-3, 3e-3])), Cloud(np.arange(27.0).reshape(3, 3, 3))]
)
def test_files_keep_it(extent: Extent | None, tmp_path: Path) -> None:
    path = tmp_path / "spray.npz"
    write_spray(path, Spray(parcels=_parcels(extent)))
    found = read_spray(path).parcels
    assert found is not None
    assert type(found.extent) is type(extent)
    for name, value in vars(extent).items() if extent is not None else ():
        np.testing.assert_array_equal(getattr(found.extent, name), value)


def test_files_of_the_first_layout_are_points(tmp_path: Path) -> None:
    path = tmp_path / "spray.npz"
    write_spray(path, Spray(parcels=_parcels(None)))
    with np.load(path) as archive:
        arrays = dict(archive)
    about = json.loads(str(arrays.pop("about")))
    about["layout"] = 1
    np.savez(path, about=np.array(json.dumps(about)), **arrays)
    found = read_spray(path).parcels
    assert found is not None and found.extent is None


def test_some_of_the_parcels_keep_their_own() -> None:
    chosen = np.array([True, False, True])
    cloud = Cloud(np.arange(27.0).reshape(3, 3, 3))
    taken = _parcels(cloud).take(chosen)
    assert isinstance(taken.extent, Cloud)
    np.testing.assert_array_equal(taken.extent.covariance_m2, cloud.covariance_m2[chosen])
    np.testing.assert_array_equal(taken.position_m, _parcels(None).position_m[chosen])


def test_pictures_of_a_cone_do_not_show_its_lattice() -> None:
    """Pixels of 0.55 of a cell: columns of boxes keep their mass, and no row of pixels within the
    spray is empty, as every other would be with points in the middle of cells of 1 mm."""
    spec = ConeSpray(spacing_m=1e-3, size_classes=2)
    spray = cone_spray(spec)
    assert spray.parcels is not None
    seen, frame = liquid_mass(spray, "side", pixel_m=0.55e-3)
    assert seen.sum() * 0.55e-3**2 == pytest.approx(spray.parcels.mass_kg, rel=1e-9)
    assert frame.extent_mm(seen.shape)[3] > 0.0  # row 0 is at the top
    assert frame.axes == ("x", "z") and seen[0].sum() < seen[len(seen) // 2].sum()
    rows = seen.sum(axis=1)
    inside = rows[rows > 0.3 * rows.max()]
    assert np.abs(np.diff(inside)).max() < 0.4 * rows.max()


def test_a_name_twice_and_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "spray.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("about.npy", b" " * 1_000_000)
    monkeypatch.setattr("cldit.spray.spray_file.free_bytes", lambda: 500_000)
    with pytest.raises(SprayError, match=r"unpacks to 0\.001 GB; 0\.0005 GB of memory are free"):
        read_spray(path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("about.npy", b"")
    with pytest.raises(SprayError, match=r"has about\.npy twice"):
        read_spray(path)


def parcels(depth_m: list[float], droplets: list[float]) -> Parcels:
    place = np.zeros((len(depth_m), 3))
    place[:, 2] = -np.array(depth_m)
    ones = np.ones(len(depth_m))
    return Parcels(place, 1e-5 * ones, np.array(droplets), 300.0 * ones, 700.0 * ones)


def test_it_is_by_mass_and_not_by_number_of_parcels() -> None:
    """90 of 100 parts of the mass end at 2 mm, 96 at 3 mm; the order of parcels does not matter."""
    some = parcels([0.004, 0.001, 0.003, 0.002], [4.0, 50.0, 6.0, 40.0])
    assert penetrations_m(some, (0.90, 0.95, 0.99, 1.0)) == (0.002, 0.003, 0.004, 0.004)


def test_classes_of_a_box_are_sorted_once() -> None:
    """The depth is that of a sort of all parcels, one by one."""
    rng = np.random.default_rng(3)
    depth = np.repeat(1e-4 * rng.integers(1, 300, 2000), 4)
    some = replace(parcels(list(depth), list(rng.random(8000))), extent=Box(np.full(3, 1e-4)))
    shares = (0.1, 0.5, 0.9, 0.95, 0.99)
    order = np.argsort(depth)
    reached = np.cumsum(some.masses_kg[order])
    expected = [depth[order][np.argmax(reached >= share * reached[-1])] for share in shares]
    assert penetrations_m(some, shares) == tuple(expected)


def test_what_a_model_says_itself_stays() -> None:
    spray = Spray(parcels=parcels([0.001], [1.0]), notes={"liquid_mass_kg": 5.0})
    notes = with_figures(spray).notes
    assert notes["liquid_mass_kg"] == 5.0
    assert notes["liquid_penetration_95_m"] == 0.001
    assert notes["sauter_mean_diameter_m"] == pytest.approx(1e-5)


def test_no_liquid_has_no_penetration() -> None:
    assert make_spray(EmptySpray()).notes == {}
    notes = with_figures(Spray(parcels=parcels([0.001], [0.0]))).notes
    assert notes == {"liquid_mass_kg": 0.0}


def test_models_have_them() -> None:
    notes = make_spray(ConeSpray(spacing_m=2e-3), open_device()).notes
    some = [notes[f"liquid_penetration_{percent}_m"] for percent in (90, 95, 99)]
    assert 0.0 < some[0] <= some[1] <= some[2] < notes["vapour_penetration_m"]


def spray() -> Spray:
    one = np.ones(3)
    parcels = Parcels(
        1e-3 * np.arange(9.0).reshape(3, 3), 1e-5 * one, 5 * one, 350 * one, 700 * one
    )
    cells = Cells.regular(
        origin_m=np.array([0.0, 0.0, -4e-3]), spacing_m=np.full(3, 2e-3), shape=(1, 1, 2)
    )
    vapour = Vapour(cells, np.array([1e24, 2e24]), np.array([400.0, 500.0]), 0.1)
    return Spray(parcels, vapour, notes={"time_s": 1e-3}, remarks=("a", "b"))


@needs("xarray", extra="studies")
def test_places_in_mm_and_units() -> None:
    data = spray().to_xarray()
    assert data.parcel_z.values == pytest.approx([2.0, 5.0, 8.0])
    assert data.cell_z.values == pytest.approx([-3.0, -1.0])
    assert data.cell_width_z.values == pytest.approx([2.0, 2.0])
    assert all("units" in data[name].attrs for name in data.variables)
    assert data.vapour_temperature_K.values.tolist() == [400.0, 500.0]
    assert data.attrs["time_s"] == 1e-3 and data.attrs["remarks"] == "a\nb"


@needs("xarray", extra="studies")
def test_a_spray_of_nothing() -> None:
    assert not Spray().to_xarray().variables


Make = Callable[[tuple[float, ...]], Iterator[Spray]]


def maker(asked: list[tuple[float, ...]], fails_at: float | None = None) -> Make:
    def make(times_s: tuple[float, ...]) -> Iterator[Spray]:
        asked.append(times_s)
        for time_s in times_s:
            if time_s == fails_at:
                raise SprayError("no")
            yield _spray()

    return make


def _spray() -> Spray:
    """Two droplets' parcels, and vapour in three of a grid's 24 voxels."""
    rng = np.random.default_rng(1)
    cells = Cells.regular(
        origin_m=np.array([-0.01, -0.01, -0.03]),
        spacing_m=np.full(3, 1e-3 / 3),
        shape=(2, 3, 4),
        index=np.array([1, 7, 23]),
    )
    parcels = Parcels(
        position_m=rng.normal(size=(2, 3)) * 1e-3,
        diameter_m=np.array([9e-6, 4e-6]),
        droplets=np.array([1e4, 3.3e3]),
        temperature_K=np.array([370.0, 351.7]),
        density_kg_m3=np.array([616.0, 633.1]),
    )
    vapour = Vapour(cells, np.array([1e24, 2e23, 1e20]), np.array([400.0, 500.0, 570.0]), 0.1002)
    return Spray(parcels=parcels, vapour=vapour, notes={"liquid_mass_kg": 1e-9}, remarks=("so",))


def test_computed_once(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    make = maker(made)
    spec = LagrangianSpray()
    first = cached_spray(spec, tmp_path, make)
    again = cached_spray(spec, tmp_path, make)
    assert len(made) == 1
    assert again.parcels is not None and again.vapour is not None
    assert first.parcels is not None and first.vapour is not None
    np.testing.assert_array_equal(again.parcels.position_m, first.parcels.position_m)
    np.testing.assert_array_equal(again.vapour.cells.lower_m, first.vapour.cells.lower_m)
    assert (again.notes, again.remarks) == (first.notes, first.remarks)
    cached_spray(spec.model_copy(update={"seed": 2}), tmp_path, make)
    assert len(made) == 2
    cached_spray(spec, None, make)
    assert len(made) == 3


def test_damaged_file_is_made_anew(tmp_path: Path) -> None:
    cached_spray(LagrangianSpray(), tmp_path, maker([]))
    (file,) = (tmp_path / "sprays").glob("*.npz")
    file.write_bytes(file.read_bytes()[:100])
    assert cached_spray(LagrangianSpray(), tmp_path, maker([])).parcels is not None
    assert file.stat().st_size > 100


def test_what_fails_is_not_kept(tmp_path: Path) -> None:
    make = maker([], fails_at=LagrangianSpray().time_s)
    with pytest.raises(SprayError, match="no"):
        cached_spray(LagrangianSpray(), tmp_path, make)
    assert not list((tmp_path / "sprays").glob("*.npz"))


def test_times_of_a_series_are_made_together(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    specs = [LagrangianSpray(time_s=time_s) for time_s in (3e-4, 1e-4, 2e-4)]
    cached_spray(specs[2], tmp_path, maker(made))
    with times_together([3e-4, 1e-4, 2e-4]):
        for spec in (*specs, LagrangianSpray(time_s=5e-4)):
            cached_spray(spec, tmp_path, maker(made))
    assert made == [(2e-4,), (1e-4, 3e-4), (5e-4,)]


def test_a_later_time_that_fails_is_refused_when_asked_for(tmp_path: Path) -> None:
    made: list[tuple[float, ...]] = []
    with times_together([1e-4, 2e-4]):
        early = cached_spray(LagrangianSpray(time_s=1e-4), tmp_path, maker(made, 2e-4))
        assert early.parcels is not None
        with pytest.raises(SprayError, match="no"):
            cached_spray(LagrangianSpray(time_s=2e-4), tmp_path, maker(made, 2e-4))
    assert made == [(1e-4, 2e-4), (2e-4,)]


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert cached_spray(LagrangianSpray(), tmp_path / "file", maker([])).parcels is not None
