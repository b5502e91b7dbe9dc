"""A real sprayFoam run (aachenBomb, n-heptane, 1.0 ms) as OpenFOAM case and as foamToVTK output.

CLDIT_AACHENBOMB names the folder with A_aachenBomb_ascii.tar.gz and A_aachenBomb_vtk.tar.gz.
"""

from __future__ import annotations

import os
import tarfile
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.mapping.file import ColumnMap
from cldit.cfd.mesh.faces import Mesh
from cldit.cfd.openfoam.case import read_openfoam
from cldit.cfd.openfoam.cloud import decode
from cldit.cfd.openfoam.file import read_foam
from cldit.cfd.openfoam.lists import particles
from cldit.cfd.to_spray import read_cfd
from cldit.io.progress import silent
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Spray

FOLDER = os.environ.get("CLDIT_AACHENBOMB")
pytestmark = pytest.mark.skipif(
    FOLDER is None, reason="CLDIT_AACHENBOMB does not name the folder with the archives"
)
# the figures that were handed over with the archives
EXPECTED = {
    "parcels": 2059,
    "droplets": 3.230e6,
    "liquid_mass_kg": 0.5061e-6,
    "vapour_mass_kg": 4.6458e-6,
    "sauter_mean_diameter_m": 10.62e-6,
    "vapour_mass_fraction_max": 0.2954,
    "gas_temperature_min_K": 495.0,
    "gas_temperature_max_K": 798.0,
}


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    assert FOLDER is not None
    found: dict[str, Path] = {}
    for kind in ("ascii", "vtk"):
        if kind == "vtk":
            pytest.importorskip("vtkmodules")
        folder = tmp_path_factory.mktemp(kind)
        with tarfile.open(Path(FOLDER) / f"A_aachenBomb_{kind}.tar.gz") as archive:
            archive.extractall(folder, filter="data")
        found[kind] = folder / f"A_aachenBomb_{kind}"
    return found


def read(case: Path) -> Spray:
    return read_cfd(CfdSpray(file=case, nozzle_m=(0.0, 0.0995, 0.0), axis="-y"))


@pytest.mark.parametrize("kind", ["ascii", "vtk"])
def test_figures(cases: dict[str, Path], kind: str) -> None:
    notes = read(cases[kind]).notes
    for name, expected in EXPECTED.items():
        # the figures are printed with four digits, temperatures with three
        digits = 0.5 if name.endswith("_K") else 10.0 ** (np.floor(np.log10(expected)) - 3) / 2
        digits = digits if name != "vapour_mass_kg" else 0.5e-10
        assert abs(notes[name] - expected) <= 1.0001 * max(digits, 0.0), name
    assert notes["time_s"] == 0.001


def test_both_forms_are_one_spray(cases: dict[str, Path]) -> None:
    """To the float32 of the second: 1e-7 of a value, and 4e-9 m in 0.1 m of the case."""
    one, two = read(cases["ascii"]), read(cases["vtk"])
    assert one.parcels is not None
    assert two.parcels is not None
    assert one.vapour is not None
    assert two.vapour is not None
    for name in ("diameter_m", "droplets", "temperature_K", "density_kg_m3"):
        assert getattr(two.parcels, name) == pytest.approx(getattr(one.parcels, name), rel=1e-6)
    assert two.parcels.position_m == pytest.approx(one.parcels.position_m, abs=5e-9, rel=0)
    assert two.vapour.cells.lower_m == pytest.approx(one.vapour.cells.lower_m, abs=5e-9, rel=0)
    assert two.vapour.cells.upper_m == pytest.approx(one.vapour.cells.upper_m, abs=5e-9, rel=0)
    found = two.vapour.number_density_m3
    assert found == pytest.approx(one.vapour.number_density_m3, rel=1e-6)
    for name, value in one.notes.items():
        assert two.notes[name] == pytest.approx(value, rel=1e-6, abs=1e-8)


def test_nozzle_is_found(cases: dict[str, Path]) -> None:
    told = read_cfd(CfdSpray(file=cases["ascii"])).notes
    seen = read_cfd(CfdSpray(file=cases["vtk"])).notes
    for notes, slack in ((told, 0.0), (seen, 0.095e-3)):  # the radius of the hole
        assert [notes[f"axis_{name}"] for name in "xyz"] == [0.0, -1.0, 0.0]
        nozzle = [notes[f"nozzle_{name}_m"] for name in "xyz"]
        assert nozzle == pytest.approx([0.0, 0.0995, 0.0], abs=slack, rel=0)


def test_barycentric_coordinates_are_the_positions(cases: dict[str, Path]) -> None:
    """The run wrote both, with eight digits: 5e-9 of 0.1 m."""
    case = read_openfoam(CfdSpray(file=cases["ascii"]), ColumnMap(), silent)
    file = read_foam(cases["ascii"] / "0.001" / "lagrangian" / "sprayCloud" / "coordinates")
    assert case.cloud is not None
    assert isinstance(case.mesh, Mesh)
    found = decode(file, particles(file), case.mesh)
    assert found == pytest.approx(case.cloud.position_m.values, abs=5e-9, rel=0)
