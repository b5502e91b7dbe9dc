"""What a case does not say, and what stands for it, is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_converge
from tests.unit.cfd.reading import read
from tests.unit.cfd.test_vtk import block_grid, save, vtk_array


def told(path: Path, **keys: Any) -> str:
    return " ".join(read(path, **keys).remarks)


def test_misspelt_density(tmp_path: Path) -> None:
    name = "rhoo"
    block, gas, cloud = foam.sample()
    density = gas.pop("rho")
    case = foam.write(tmp_path / "case", block, gas=gas | {name: density}, cloud=cloud)
    said = told(case)
    assert "no density 'rho' among the cell fields" in said
    assert f"if it is '{name}', name it in a mapping file" in said
    assert (
        "that of an ideal gas of air and fuel at T and p (4.004e+06 to 4.88e+06 Pa) was used"
        in said
    )
    mapping = tmp_path / "names.yaml"
    mapping.write_text(f"cells: {{density: {name}}}")
    assert "at p and T was used" not in told(case, mapping=mapping)


def test_whole_case_says_nothing(tmp_path: Path) -> None:
    said = told(foam.case(tmp_path))
    assert "ideal" not in said and "Molar mass" not in said and "its time" not in said


def test_density_alone_and_no_time(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    del gas["p"]
    said = told(save(tmp_path / "gas.vtu", block_grid(block, gas)), cloud="none")
    assert "no pressure among the cell fields" in said
    assert "does not state its time" in said


def test_another_fuel_has_its_own_molar_mass(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    gas["C8H18"] = gas.pop("C7H16")
    case = foam.write(tmp_path, block, gas=gas, cloud=cloud)
    assert "Fuel C8H18, 0.114232 kg/mol." in told(case, fuel_field="C8H18")
    by_formula = read(case, fuel_field="C8H18").vapour
    assert by_formula is not None and by_formula.molar_mass_kg_mol == pytest.approx(0.114232)
    said = told(case, fuel_field="C8H18", fuel_molar_mass_kg_mol=0.1)
    assert "Molar mass of C8H18: 0.1 kg/mol, as given; by its formula it is 0.1142" in said
    assert "Molar mass" not in told(case, fuel_field="C8H18", fuel_molar_mass_kg_mol=0.11423)


def test_two_names_of_one_quantity(tmp_path: Path) -> None:
    import h5py

    folder = write_converge(tmp_path, foam.sample(), new=True)
    for path in folder.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            cells = file["STREAM_00/CELL_CENTER_DATA"]
            cells["TEMP"] = np.full_like(cells["TEMPERATURE"][()], 300)
    assert "of TEMPERATURE and TEMP, TEMPERATURE was used as the temperature" in told(folder)


def test_weight_of_means_over_corners(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    grid = block_grid(block, {name: gas[name] for name in ("p", "T", "rho")})
    count = grid.GetNumberOfPoints()
    for name, value in (("C7H16", 0.1), ("p", 5e5), ("T", 500.0)):
        grid.GetPointData().AddArray(vtk_array(name, np.full(count, value)))
    said = told(save(tmp_path / "gas.vtu", grid), cloud="none")
    assert "C7H16 (weighted by p/T, as there is no density at points) at points became" in said
