"""Mappings that are drafted read as the case; what a case does not state is a remark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.cfd.formats import read_case
from cldit.cfd.mapping.file import read_column_map
from cldit.cfd.mapping_draft import write_mapping
from cldit.cli import main
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_converge
from tests.unit.cfd.reading import read
from tests.unit.cfd.vtkfiles import block_grid, save, vtk_array


def test_draft_of_an_openfoam_case(tmp_path: Path) -> None:
    write_mapping(CfdSpray(file=foam.case(tmp_path / "case")), tmp_path / "foam.yaml")
    text = (tmp_path / "foam.yaml").read_text()
    assert "  diameter: {column: d, unit: m}" in text
    assert "  velocity: {columns: [U_X, U_Y, U_Z], unit: m/s}" in text
    assert "  # age: {column: NAME, unit: s}  # not found; without it spray.nozzle_m is" in text


def test_what_is_missing_is_proposed(tmp_path: Path) -> None:
    """The line without its # makes the case read."""
    block, gas, _ = foam.sample()
    names = {"Temperature [K]": gas["T"], "dens": gas["rho"], "C7H16": gas["C7H16"]}
    case, out = save(tmp_path / "gas.vtu", block_grid(block, names)), tmp_path / "names.yaml"
    done = CliRunner().invoke(main, ["import", str(case), "--write-mapping", str(out)])
    assert done.exit_code == 0, done.output
    assert "not found: temperature" in done.output
    text = out.read_text()
    assert "# temperature: {column: 'Temperature [K]', unit: K}  # not found; needed" in text
    assert "# parcels" not in text
    out.write_text(text.replace("# temperature", "temperature").replace("# density", "density"))
    spray = read(case, mapping=out, cloud="none")
    assert spray.notes["gas_temperature_max_K"] == pytest.approx(gas["T"].max())
    assert "at p and T was used" not in " ".join(spray.remarks)
    before = out.read_text()
    done = CliRunner().invoke(main, ["import", str(case), "--write-mapping", str(out)])
    assert done.exit_code == 1 and "exists already" in done.output
    assert out.read_text() == before


def test_begun_from_a_table(tmp_path: Path) -> None:
    """Both tables of STAR-CCM+'s kind of header; the units are in the names."""
    cells = tmp_path / "cells.csv"
    cells.write_text(
        '"Temperature (K)","Density (kg/m^3)","Mass Fraction of C7H16","Volume (m^3)",'
        '"Velocity: Magnitude (m/s)","X (m)","Y (m)","Z (m)"\n'
        "500,8,0.1,1e-9,3,0,0.0,0\n510,8,0.0,1e-9,3,0,0.001,0\n"
    )
    drops = tmp_path / "drops.csv"
    drops.write_text(
        '"Particle Diameter (m)","Particle Count","Temperature (C)","Density (kg/m^3)",'
        '"Velocity[i] (m/s)","Velocity[j] (m/s)","Velocity[k] (m/s)","X (mm)","Y (mm)","Z (mm)"\n'
        "1e-5,1000,90,684,0,-20,1,0.1,0.2,0\n"
    )
    for file in (cells, drops):
        done = CliRunner().invoke(main, ["import", str(file)])
        assert done.exit_code == 1 and "--write-mapping" in done.output
        out = file.with_suffix(".yaml")
        done = CliRunner().invoke(main, ["import", str(file), "--write-mapping", str(out)])
        assert done.exit_code == 0, done.output
    both = tmp_path / "case.yaml"
    first, second = (file.with_suffix(".yaml").read_text() for file in (cells, drops))
    both.write_text(first[: first.index("# parcels:")] + second[second.index("\nparcels:") :])
    spray = read(both, nozzle_m=(0, 0, 0), axis=(0, 1, 0))
    assert spray.notes["vapour_mass_kg"] == pytest.approx(0.1 * 8 * 1e-9)
    assert spray.parcels is not None
    assert spray.parcels.temperature_K[0] == 363.15
    mass = 1000 * 684 * 3.141592653589793 / 6 * 1e-15
    assert spray.notes["liquid_mass_kg"] == pytest.approx(mass, rel=1e-12)


def test_components_in_brackets_are_no_unit(tmp_path: Path) -> None:
    """`[i]` as STAR-CCM+ writes it, where the unit is left out."""
    (tmp_path / "c.csv").write_text("x,y,z,V,T,rho,C7H16\n0,0,0,1e-9,500,8,0.1\n")
    (tmp_path / "p.csv").write_text(
        "X [mm],Y [mm],Z [mm],d,n,T,Velocity[i],Velocity[j],Velocity[k]\n"
        "0.1,0.2,0,1e-5,1000,350,0,-20,1\n"
    )
    (tmp_path / "m.yaml").write_text(
        "cells: {file: c.csv, position: [x, y, z], volume: V, temperature: T, density: rho,\n"
        "  fuel: C7H16}\n"
        "parcels: {file: p.csv, position: ['X [mm]', 'Y [mm]', 'Z [mm]'], diameter: d, number: n,\n"
        "  velocity: ['Velocity[i]', 'Velocity[j]', 'Velocity[k]'], temperature: T, density: 684}\n"
    )
    cloud = read_case(CfdSpray(file=tmp_path / "m.yaml")).cloud
    assert cloud is not None
    assert cloud.fields["U"].values.tolist() == [[0.0, -20.0, 1.0]]
    assert cloud.position_m.values[0] == pytest.approx([1e-4, 2e-4, 0.0])


@pytest.mark.parametrize("name", ["C7H16.Mass Fraction", "Mole Fraction of C7H16", "molef-c7h16"])
def test_the_fuel_of_a_table_by_the_names_of_programs(tmp_path: Path, name: str) -> None:
    (tmp_path / "cells.csv").write_text(f"x,y,z,V,T,p,{name}\n0,0,0,1e-9,700,5e6,0.1\n")
    write_mapping(CfdSpray(file=tmp_path / "cells.csv"), tmp_path / "m.yaml")
    cells = read_column_map(tmp_path / "m.yaml").cells
    assert cells.fuel is not None
    assert cells.fuel.column == name


def test_a_unit_of_the_draft_is_allowed_once_its_line_is_used(tmp_path: Path) -> None:
    (tmp_path / "cells.csv").write_text("x,y,z,V,T,p,other\n0,0,0,1e-9,700,5e6,0.1\n")
    write_mapping(CfdSpray(file=tmp_path / "cells.csv"), tmp_path / "m.yaml")
    text = (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_text(text.replace("# fuel: {column: NAME", "fuel: {column: other"))
    cells = read_column_map(tmp_path / "m.yaml").cells
    assert cells.fuel is not None
    assert cells.fuel.unit == "1"


def told(path: Path, **keys: Any) -> str:
    return " ".join(read(path, **keys).remarks)


def test_misspelt_density(tmp_path: Path) -> None:
    name, density = "rhoo", foam.sample()[1]["rho"]
    case = foam.case(tmp_path / "case", gas={"rho": None, name: density})
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
    case = foam.case(tmp_path, gas={"C7H16": None, "C8H18": foam.sample()[1]["C7H16"]})
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
