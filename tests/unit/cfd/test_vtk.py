"""foamToVTK's layouts, written through vtk: the spray is that of the OpenFOAM case."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.formats import contents
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import FRAME, arrays_of, notes_of, read, refused
from tests.unit.cfd.vtkfiles import block_grid, cloud_data, grid_of, mark_ghosts, save, stamped

pytest.importorskip("vtkmodules")

# one of each: points, and the faces of the polyhedron (a cube); volumes by hand
SOLIDS: dict[int, tuple[list[tuple[float, float, float]], float]] = {
    10: ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], 1 / 6),
    11: ([(x, y, z) for z in (0, 3) for y in (0, 2) for x in (0, 1)], 6.0),
    12: ([(x, y, z) for z in (0, 3) for x, y in ((0, 0), (1, 0), (1, 2), (0, 2))], 6.0),
    13: ([(x, y, z) for z in (0, 2) for x, y in ((0, 0), (0, 1), (1, 0))], 1.0),
    14: ([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 1, 3)], 4.0),
    42: ([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], 1.0),
}
CUBE = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def series(file: Path, entries: Mapping[str, float]) -> None:
    files = [{"name": name, "time": time} for name, time in entries.items()]
    file.write_text(json.dumps({"file-series-version": "1.0", "files": files}))


def two_steps(folder: Path, layout: str) -> dict[str, Path]:
    """Steps 10 (0.0005 s, only three parcels) and 20 (0.001 s); the mesh files by step."""
    block, gas, cloud = foam.sample()
    few = {name: values[:3] for name, values in cloud.items()}
    meshes: dict[str, Path] = {}
    for step, time, parcels in (("10", 0.0005, few), ("20", 0.001, cloud)):
        grid = stamped(block_grid(block, gas), time)
        if layout == "xml":
            mesh, drops = f"case_{step}/internal.vtu", f"lagrangian/rain/rain_{step}.vtp"
            patch = f"case_{step}/boundary/walls.vtp"
        elif layout == "nested":
            mesh, drops = f"case_{step}/internal.vtu", f"case_{step}/lagrangian/rain/rain.vtp"
            patch = f"case_{step}/boundary/walls.vtp"
        else:
            mesh, drops = f"case_{step}.vtk", f"lagrangian/rain/rain_{step}.vtk"
            patch = f"walls/walls_{step}.vtk"
        meshes[step] = save(folder / mesh, grid)
        save(folder / drops, cloud_data(parcels))
        save(folder / patch, cloud_data(few))
    if layout == "xml":
        series(folder / "case.vtm.series", {"case_10.vtm": 0.0005, "case_20.vtm": 0.001})
        (folder / "case_20.vtm").touch()
    return meshes


@pytest.mark.parametrize("layout", ["xml", "nested", "legacy"])
def test_layouts_and_times(tmp_path: Path, layout: str) -> None:
    meshes = two_steps(tmp_path / "VTK_7", layout)
    foam.case(tmp_path / "case")
    expected = read(tmp_path / "case")
    last = [tmp_path / "VTK_7", meshes["20"]]
    if layout == "xml":
        drops = tmp_path / "VTK_7" / "lagrangian" / "rain" / "rain_20.vtp"
        last += [meshes["20"].parent, tmp_path / "VTK_7" / "case_20.vtm", drops]
        last += [tmp_path / "VTK_7" / "case.vtm.series"]
    for path in last:
        spray = read(path)
        assert spray.notes["time_s"] == pytest.approx(0.001, rel=1e-7)  # maybe a float32
        # float32 of 1e-2 m: half an ulp is 5e-10 m; volumes of cells of 1e-3 m follow
        for name, values in arrays_of(spray).items():
            place = name in ("position_m", "lower_m", "upper_m")
            limit = 2e-9 if place else 2e-7 * np.abs(values)
            assert np.all(np.abs(values - arrays_of(expected)[name]) <= limit), name
        for name in ("liquid_mass_kg", "vapour_mass_kg", "sauter_mean_diameter_m"):
            assert spray.notes[name] == pytest.approx(expected.notes[name], rel=5e-6)
    assert notes_of(meshes["10"])["parcels"] == 3
    early = read(tmp_path / "VTK_7", time_s=0.0005, cloud="rain")
    assert early.notes["parcels"] == 3
    refused(tmp_path / "VTK_7", r"no time 0\.002 s .* available: 0\.0005, 0\.001", time_s=0.002)


@pytest.mark.parametrize("copies", [1, 2])
def test_every_kind_of_cell(tmp_path: Path, copies: int) -> None:
    """Volumes and centroids of each kind, by hand, of a gas that is all fuel; copies are ghosts."""
    points: list[tuple[float, float, float]] = []
    cells: list[tuple[int, Any]] = []
    for column, (kind, (corners, _)) in enumerate(SOLIDS.items()):
        first = len(points)
        # a quarter of its size: what is wider than 10 m is taken for millimetres
        points += [(x / 4 + 1.25 * column, y / 4, z / 4) for x, y, z in corners]
        faces = [[first + corner for corner in face] for face in CUBE]
        cells.append((kind, faces if kind == 42 else range(first, len(points))))
    count = len(cells)
    gas = {
        name: np.full(copies * count, v) for name, v in (("T", 300), ("rho", 0.01), ("C7H16", 1))
    }
    grid = grid_of(copies * cells, points, gas)
    mark_ghosts(grid.GetCellData(), np.arange(copies * count) < (copies - 1) * count)
    file = save(tmp_path / "internal.vtu", grid)
    vapour = read(file, nozzle_m=(0, 0, 0), axis="-z").vapour
    assert vapour is not None
    # quarters are exact in float32
    volumes = [volume / 64 for _, volume in SOLIDS.values()]
    assert vapour.cells.volume_m3 == pytest.approx(volumes, rel=1e-12)
    middle = (vapour.cells.lower_m + vapour.cells.upper_m) / 2 * 4
    middle[:, 0] -= 5.0 * np.arange(count)
    tet, box, wedge = (0.25, 0.25, 0.25), (0.5, 1.0, 1.5), (1 / 3, 1 / 3, 1.0)
    centroids = np.array([tet, box, box, wedge, (1.0, 1.0, 0.75), (0.5, 0.5, 0.5)])
    assert middle == pytest.approx(centroids, abs=1e-12)


def test_same_kind_only(tmp_path: Path) -> None:
    """vtk keeps no list of types for a grid of one type."""
    points, volume = SOLIDS[14]
    gas = {"T": [300], "rho": [1 / 64], "C7H16": [1]}
    file = save(tmp_path / "a.vtu", grid_of([(14, range(5))], points, gas))
    spray = read(file, nozzle_m=(0, 0, 0), axis="-z")
    assert spray.notes["vapour_mass_kg"] == pytest.approx(volume / 64, rel=1e-7)
    assert "time_s" not in spray.notes
    refused(
        file,
        r"not all state their time; .*pieces of one state",
        time_s=0.1,
        nozzle_m=(0, 0, 0),
        axis="-z",
    )


def test_missing_and_impossible(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    mesh, drops = tmp_path / "internal.vtu", tmp_path / "lagrangian" / "rain" / "rain.vtp"

    def written_and_refused(message: str, gas: Mapping[str, Any], cloud: Mapping[str, Any]) -> None:
        save(mesh, block_grid(block, gas))
        save(drops, cloud_data(cloud))
        refused(mesh, message)

    rest = {key: values for key, values in gas.items() if key != "T"}
    written_and_refused(r"internal\.vtu: no cell field 'T'.*; it has: .*p, rho", rest, cloud)
    rest = {key: values for key, values in cloud.items() if key != "d"}
    written_and_refused(r"rain\.vtp: cloud 'rain' has no field 'd'; it has: ", gas, rest)
    bad = np.where(np.arange(block.cells) == 5, np.nan, gas["T"])
    written_and_refused(r"internal\.vtu: cell field T: nan \(entry 5\)", gas | {"T": bad}, cloud)
    written_and_refused(r"rain\.vtp: point field T: shape .17, 3.", gas, cloud | {"T": cloud["U"]})


def test_files_of_another_kind(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    keys: dict[str, Any] = {"nozzle_m": (0, 0, 0), "axis": "-z"}
    flat = grid_of([(9, (0, 1, 2, 3))], SOLIDS[14][0], {"T": [3], "rho": [1], "C7H16": [1]})
    with pytest.raises(SprayError, match=r"no gas: .* \(lines or surfaces in .*flat\.vtu\)"):
        read_cfd(CfdSpray(file=save(tmp_path / "1" / "flat.vtu", flat), **keys))
    with pytest.raises(SprayError, match=r"none\.vtu: the mesh has no cell"):
        read_cfd(CfdSpray(file=save(tmp_path / "2" / "none.vtu", grid_of([], [], {})), **keys))
    text = save(tmp_path / "4" / "a.vtk", block_grid(block, gas))
    text.write_bytes(text.read_bytes().replace(b"BINARY", b"ASCII", 1))
    with pytest.raises(SprayError, match=r"a\.vtk: is legacy VTK in ascii"):
        read_cfd(CfdSpray(file=text, **keys))


def test_step_that_lacks_its_cloud(tmp_path: Path) -> None:
    two_steps(tmp_path, "xml")
    (tmp_path / "lagrangian" / "rain" / "rain_20.vtp").unlink()
    refused(tmp_path, "no cloud file of the same step '20', but other steps")
    (tmp_path / "case.vtm.series").write_text('{"files": [{"name": 3}]}')
    refused(tmp_path, r"case\.vtm\.series: is no list of files and times")


def test_without_vtk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    block, gas, _ = foam.sample()
    save(tmp_path / "internal.vtu", block_grid(block, gas))
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkCommonCore", None)
    refused(tmp_path, r'needs vtk; install it with: .* "vtk>=')


def test_a_listed_step_that_is_missing(tmp_path: Path) -> None:
    """The latest time is not taken for another; a time that is there is read."""
    folder = tmp_path / "VTK"
    two_steps(folder, "xml")
    (folder / "case_20" / "internal.vtu").unlink()
    missing = r"case\.vtm\.series: lists step 20 \(0\.001 s\), and its mesh is missing.*0\.0005"
    for time in ({}, {"time_s": 0.001}):
        refused(folder, missing, **time)
        with pytest.raises(SprayError, match=missing):
            contents(CfdSpray(file=folder, **FRAME, **time))
    assert notes_of(folder, time_s=0.0005)["time_s"] == 0.0005


def test_lists_of_several_runs(tmp_path: Path) -> None:
    two_steps(tmp_path, "xml")
    rain = tmp_path / "lagrangian/rain/rain.vtp.series"
    series(rain, {"rain_10.vtp": 0.0005, "rain_20.vtp": 0.0007})
    refused(tmp_path, r"rain\.vtp\.series: lists step 20 at 0\.0007 s, .*case.* at 0\.001 s; allo")
    rain.unlink()
    series(tmp_path / "case.vtm.series", {"case_10.vtm": 0.0005, "case_20.vtm": 0.002})
    refused(tmp_path, r"internal\.vtu: states the time 0\.001.*, .*\.series the time 0\.002")


def test_a_listed_cloud_that_is_missing(tmp_path: Path) -> None:
    """Of two clouds one is left of this step: it is not taken for the only one."""
    folder = tmp_path / "VTK"
    two_steps(folder, "xml")
    _, _, cloud = foam.sample()
    snow = folder / "lagrangian" / "snow"
    save(snow / "snow_10.vtp", cloud_data(cloud))
    series(snow / "snow.vtp.series", {"snow_10.vtp": 0.0005, "snow_20.vtp": 0.001})
    refused(folder, r"lists step 20 .*whose file snow_20\.vtp is missing")
