"""The octree of a run for ParaView, read back by vtk's own readers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance
from cldit.run import Run, open_run, simulate
from cldit.run.octree_export import export_octree
from cldit.scene import Scene, parse_scene
from tests.command_line import command

Array = NDArray[np.float64]
CELLS, EDGE_m = 12, 0.06
COLUMNS, ROWS = 12, 10


def grid_scene(folder: Path, order: int | None) -> Scene:
    """A cloud of given coefficients before a disc that fills the picture, in cells of its own."""
    z, y, x = np.meshgrid(*3 * [(np.arange(CELLS) + 0.5) / CELLS - 0.5], indexing="ij")
    blob = np.exp(-20.0 * (x**2 + 2 * y**2 + (z - 0.1) ** 2)).T
    blob[blob < 0.2] = 0.0
    np.savez(
        folder / "grid.npz",
        origin_m=np.full(3, -EDGE_m / 2),
        spacing_m=np.full(3, EDGE_m / CELLS),
        vapour_absorption_per_m=8.0 * blob,
        droplet_absorption_per_m=6.0 * blob[::-1],
        droplet_scattering_per_m=40.0 * blob[::-1],
        vapour_temperature_K=np.full(blob.shape, 500.0),
        droplet_temperature_K=np.full(blob.shape, 380.0),
    )
    return parse_scene(
        {
            "name": "given",
            "spray": {"model": "grid", "file": str(folder / "grid.npz")},
            "domain": {"edge_m": 0.08, "leaf_edge_m": 0.006},
            "camera": {"pixels": [COLUMNS, ROWS], "field_m": [0.06, 0.05]},
            "background": {"temperatures_K": [440.0, 480.0], "radius_m": 0.2},
            "transport": {"order": order, "accuracy_K": 0.2, "audit": False},
        }
    )


@pytest.fixture(scope="module")
def order_0(tmp_path_factory: pytest.TempPathFactory, device: Device, tables: Path) -> Run:
    folder = tmp_path_factory.mktemp("order 0")
    return simulate(grid_scene(folder, 0), folder / "run", device=device, cache=tables)


def read(path: Path) -> Any:
    """The data set of a file, by vtk."""
    from vtkmodules import vtkIOXML

    name = "UnstructuredGrid" if path.suffix == ".vtu" else "PolyData"
    reader: Any = getattr(vtkIOXML, f"vtkXML{name}Reader")()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def cells(grid: Any) -> tuple[Array, Array, dict[str, Array]]:
    """Lower and upper corner (N, 3) of the cells, and their fields; each is a box by its volume."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

    convert: Any = numpy_support.vtk_to_numpy
    sizes: Any = vtkCellSizeFilter()
    sizes.SetInputData(grid)
    sizes.Update()
    data = sizes.GetOutput().GetCellData()
    fields = {
        data.GetArrayName(n): convert(data.GetArray(n)) for n in range(data.GetNumberOfArrays())
    }
    points = convert(grid.GetPoints().GetData())
    corners = points[convert(grid.GetCells().GetConnectivityArray()).reshape(-1, 8)]
    lower, upper = corners.min(axis=1), corners.max(axis=1)
    assert np.allclose(np.prod(upper - lower, axis=1), fields["Volume"], rtol=1e-9)
    return lower, upper, fields


def segments(
    scene: Scene, lower: Array, upper: Array, column: int, row: int
) -> tuple[Array, Array]:
    """Where a pixel's line of sight enters each cell, and how far it goes in it, m (N,)."""
    width, height = scene.camera.field_m
    x, z = ((column + 0.5) / COLUMNS - 0.5) * width, (0.5 - (row + 0.5) / ROWS) * height
    at = np.array(scene.target_m) + np.array([x, 0.0, z])
    eye = np.array(scene.target_m) - [0.0, scene.camera.distance_m, 0.0]
    along = (at - eye) / np.linalg.norm(at - eye)
    with np.errstate(divide="ignore"):
        near, far = (lower - eye) / along, (upper - eye) / along
    enter = np.minimum(near, far).max(axis=1)
    return enter, np.maximum(np.maximum(near, far).min(axis=1) - enter, 0.0)


def test_optical_depth_along_pixels(
    order_0: Run, device: Device, tables: Path, tmp_path: Path
) -> None:
    """At order 0 what comes of the background is exp(-tau): the same along the exported cells.

    Two float32 values a cell and some 30 cells along a ray: 30 x 1e-7, and 1e-7 over the least
    transmission, 0.4.
    """
    target = tmp_path / "cells.vtu"
    written = export_octree(order_0, target, device=device, cache=tables)
    assert written == [target]  # a spray of coefficients has no parcels
    lower, upper, fields = cells(read(target))
    assert fields["Volume"].sum() == pytest.approx(0.08**3, rel=1e-9)
    for name in ("vapour_absorption", "droplet_absorption", "droplet_scattering"):
        whole = float((fields[f"{name}_per_m"] * fields["Volume"]).sum())
        given = np.load(order_0.scene.spray.file)[f"{name}_per_m"].sum()  # type: ignore[union-attr]
        assert whole == pytest.approx(given * (EDGE_m / CELLS) ** 3, rel=1e-6)
    sum_ = sum(
        fields[f"{name}_per_m"]
        for name in ("vapour_absorption", "droplet_absorption", "droplet_scattering")
    )
    assert np.allclose(fields["extinction_per_m"], sum_, rtol=1e-6)
    depths = []
    for column, row in [(5, 4), (6, 5), (5, 6), (8, 3), (0, 0)]:
        _, length = segments(order_0.scene, lower, upper, column, row)
        depths.append(float(length @ fields["extinction_per_m"]))
        seen = -np.log(float(order_0.weights.background[row, column]))
        assert depths[-1] == pytest.approx(seen, abs=1e-5)
    assert max(depths) > 0.5 and depths[-1] == 0.0


def test_temperatures_are_those_of_the_phases(
    order_0: Run, device: Device, tables: Path, tmp_path: Path
) -> None:
    """float32 emission and absorption: 1e-7 of a radiance that rises with T to about the ninth."""
    path = tmp_path / "cells.vtu"
    export_octree(order_0, path, device=device, cache=tables)
    _, _, fields = cells(read(path))
    for phase, kelvin in (("vapour", 500.0), ("droplet", 380.0)):
        found = fields[f"{phase}_temperature_K"]
        there = fields[f"{phase}_absorption_per_m"] > 0
        assert 0 < there.sum() < len(there)
        assert np.allclose(found[there], kelvin, atol=1e-3)
        assert np.isnan(found[~there]).all()


def test_source_function_makes_the_picture(device: Device, tables: Path, tmp_path: Path) -> None:
    """Integrated along a pixel with what lies behind, it is the picture before that background.

    Sources are constant in the exported cells and linear in the picture's: cells of optical depth
    0.1 differ by some (0.1)^2, and the light of the medium is a part of all.
    """
    scene = grid_scene(tmp_path, None)
    run = simulate(scene, tmp_path / "run", device=device, cache=tables)
    path = tmp_path / "cells.vtu"
    export_octree(run, path, device=device, cache=tables)
    lower, upper, fields = cells(read(path))
    (node,) = run.quadrature.nodes
    bounds = Boundary.of(Surroundings.from_scene(scene), node.radiance, node.pane)
    at_K = run.quadrature.reference_K
    seen = camera_radiance(run.spectral, [bounds], background_K=at_K)
    for column, row in [(5, 4), (6, 5), (5, 6), (8, 3)]:
        enter, length = segments(scene, lower, upper, column, row)
        order = np.argsort(enter)
        depth = (length * fields["extinction_per_m"])[order]
        behind = np.cumsum(depth)
        own = fields["source_function_photons_per_s_m2_sr"][order]
        light = np.sum(own * (np.exp(depth - behind) - np.exp(-behind)))
        whole = light + float(bounds.leaving(at_K)) * np.exp(-behind[-1])
        assert light > 0.1 * whole
        assert whole == pytest.approx(float(seen[row, column]), rel=5e-3)


def test_what_has_changed_is_not_exported(
    order_0: Run, device: Device, tables: Path, tmp_path: Path
) -> None:
    assert order_0.folder is not None
    known = json.loads((order_0.folder / "run.json").read_text())
    del known["sha256"]  # of a folder whose files nobody verifies

    def refused(change: dict[str, Any], match: str) -> None:
        folder = tmp_path / "run"
        folder.mkdir(exist_ok=True)
        for each in order_0.folder.rglob("*"):  # type: ignore[union-attr]
            if each.is_file():
                copy = folder / each.relative_to(order_0.folder)  # type: ignore[arg-type]
                copy.parent.mkdir(parents=True, exist_ok=True)
                copy.write_bytes(each.read_bytes())
        (folder / "run.json").write_text(json.dumps(known | change))
        with pytest.raises(RunFolderError, match=match):
            export_octree(open_run(folder), None, device=device, cache=tables)
        assert not list(folder.glob("octree*"))

    (integrals,) = known["integrals"]
    refused(
        {
            "integrals": [
                integrals | {"droplet_scattering_m2": 1.01 * integrals["droplet_scattering_m2"]}
            ]
        },
        "octree of node 0: droplet_scattering_m2",
    )
    refused({"spray": known["spray"] | {"voxels_filled": 3.0}}, "spray: voxels_filled: 3.0")
    stages = [s | ({"note": "1 leaves"} if s["name"] == "octree" else {}) for s in known["stages"]]
    refused({"stages": stages}, "octree: 1 leaves in run.json")
    refused({"plan": None}, "holds no plan")
    with pytest.raises(RunFolderError, match=r"no node 1; allowed: 0\.\.0"):
        export_octree(order_0, tmp_path / "a.vtu", device=device, cache=tables, node=1)
    file = Path(order_0.scene.spray.file)  # type: ignore[union-attr]
    arrays = dict(np.load(file))
    kept = file.read_bytes()
    try:
        np.savez(
            file, **arrays | {"vapour_absorption_per_m": 1.1 * arrays["vapour_absorption_per_m"]}
        )
        with pytest.raises(RunFolderError, match="spray: vapour_absorption"):
            export_octree(order_0, tmp_path / "a.vtu", device=device, cache=tables)
    finally:
        file.write_bytes(kept)


TABLES = """
time_s: 0.001
cells:
  file: cells.csv
  position: [x, y, z]
  volume: V
  temperature: T
  density: 8
  fuel: Y
parcels:
  file: parcels.csv
  position: [x, y, z]
  diameter: d
  number: n
  temperature: 350
  density: 684
"""


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """Cells of 2 mm and parcels about a jet from (0.03, 0.02, 0.01) m along +y."""
    (tmp_path / "case.yaml").write_text(TABLES)
    steps = np.arange(-5, 5) * 2e-3 + 1e-3
    x, y, z = (each.reshape(-1) for each in np.meshgrid(steps, steps, steps))
    fuel = np.where(x**2 + z**2 < 2e-5, 0.1, 0.0)
    rows = np.stack(
        [x + 0.03, y + 0.03, z + 0.01, np.full_like(x, 8e-9), x * 0 + 500, fuel], axis=1
    )
    np.savetxt(tmp_path / "cells.csv", rows, delimiter=",", header="x,y,z,V,T,Y", comments="")
    rng = np.random.default_rng(5)
    place = np.array([0.03, 0.024, 0.01]) + rng.normal(size=(40, 3)) * [5e-4, 1e-3, 5e-4]
    rest = np.stack([rng.uniform(1e-5, 2e-5, 40), rng.uniform(1e3, 1e4, 40)], axis=1)
    np.savetxt(
        tmp_path / "parcels.csv",
        np.concatenate([place, rest], axis=1),
        delimiter=",",
        header="x,y,z,d,n",
        comments="",
    )
    return tmp_path


def test_a_case_of_cfd_lies_where_it_was(
    case: Path, device: Device, tables: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parcels come back where the case has them, and liquid in the cells lies about them."""
    from vtkmodules.util import numpy_support

    scene = parse_scene(
        {
            "name": "tables",
            "spray": {
                "model": "cfd",
                "file": str(case / "case.yaml"),
                "nozzle_m": [0.03, 0.02, 0.01],
                "axis": [0.1, 1.0, 0.0],
            },
            "domain": {"edge_m": 0.06, "leaf_edge_m": 1e-3},
            "camera": {"pixels": [8, 8], "field_m": [0.02, 0.02]},
            "transport": {"order": 0, "audit": False},
        }
    )
    run = simulate(scene, case / "run", device=device, cache=tables)
    command("export", case / "run", "--to", "vtu")
    grid, points = read(case / "run/octree.vtu"), read(case / "run/octree_parcels.vtp")
    convert: Any = numpy_support.vtk_to_numpy
    found = convert(points.GetPoints().GetData())
    rows = np.loadtxt(case / "parcels.csv", delimiter=",", skiprows=1)
    assert np.allclose(found, rows[:, :3], atol=1e-12)
    mass = convert(points.GetPointData().GetArray("mass_kg")).sum()
    assert mass == pytest.approx(run.info.spray["liquid_mass_kg"], rel=1e-12)
    assert mass == pytest.approx(np.sum(684 * np.pi / 6 * rows[:, 3] ** 3 * rows[:, 4]), rel=1e-12)
    corners = convert(grid.GetPoints().GetData())[
        convert(grid.GetCells().GetConnectivityArray()).reshape(-1, 8)
    ]
    middle, scattering = corners.mean(axis=1), grid.GetCellData()
    # the volume of a cell is that of the edges at its first corner
    edges = np.linalg.norm(corners[:, [1, 3, 4]] - corners[:, :1], axis=2)
    weight = convert(scattering.GetArray("droplet_scattering_per_m")) * np.prod(edges, axis=1)
    centre = weight @ middle / weight.sum()
    # by the droplets' areas, that light sees, within half a cell
    area = rows[:, 3] ** 2 * rows[:, 4]
    assert np.allclose(centre, area @ rows[:, :3] / area.sum(), atol=5e-4)

    changed = (case / "parcels.csv").read_text().replace("1", "2", 1)
    (case / "parcels.csv").write_text(changed)
    said = command("export", case / "run", "--to", "vtu", status=1).output
    assert "parcels.csv, which has changed (" in " ".join(said.split())
