"""Values that are possible one by one, in another unit or of another fuel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cldit.cfd.importing import imported
from cldit.cfd.names import fuel_of, other_fuels
from cldit.cfd.to_spray import read_cfd
from cldit.errors import OpticsError, SprayError
from cldit.optics.spectrum import liquid_of, vapour_of
from cldit.optics.wavelengths import wavelengths
from cldit.prepare.fitted_scene import fitted_scene
from cldit.scene import load_scene, parse_scene
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_tables
from tests.unit.cfd.reading import FRAME, notes_of, read, refused
from tests.unit.cfd.vtkfiles import block_grid, pvd, save


def ideal(block: Any, gas: dict[str, Any]) -> dict[str, Any]:
    moles = gas["C7H16"] / 0.100204 + (1 - gas["C7H16"]) / 0.02885
    return gas | {"rho": gas["p"] / (moles * 8.314463 * gas["T"])}


WIDE = np.random.default_rng(5).normal((0.0, -50.0, 0.0), 50.0, (17, 3))
WRONG: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any], str]] = {
    "degC": ({}, {"T": lambda T: T - 273.15}, {}, r"d/T: .* is outside 182\.6\.\.5000; .*degC"),
    "n-heptane by default": (
        {"C7H16": None, "Y_FUEL": 0.1},
        {"T": lambda T: T - 273.15},
        {"fuel_field": "Y_FUEL"},
        r"T: .* is outside 182\.6\.\.5000",
    ),
    "masses": ({}, {"nParticle": lambda n: n * 1e-9}, {}, "droplets in 17 parcels; .* as `mass`"),
    "millions": ({}, {"nParticle": lambda n: n * 1e9}, {}, "kg of liquid; allowed: up to 0.01 kg"),
    "g/cm3": ({"rho": lambda rho: 1e-3 * rho}, {}, {}, "one of them is not in kg/m3, K, Pa"),
    "bar": ({"p": lambda p: 1e-5 * p}, {}, {}, "one of them is not in kg/m3, K, Pa"),
    "wide": ({}, {"U": WIDE}, {"axis": None}, "the axis of the injection cannot .*degrees only"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_values_in_another_unit(tmp_path: Path, kind: str) -> None:
    gas, cloud, keys, message = WRONG[kind]
    refused(foam.case(tmp_path, gas=gas, cloud=cloud), message, **keys)


def test_gas_in_degrees_celsius_and_gauge_pressure(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    gas = ideal(block, gas)
    whole = foam.write(tmp_path / "K", block, gas=gas, cloud=cloud)
    assert "ideal gas" not in " ".join(read(whole).remarks)
    celsius = gas | {"T": gas["T"] - 273.15}
    refused(
        foam.write(tmp_path / "C", block, gas=celsius, cloud=cloud),
        r"T: .* seem to be degrees Celsius",
    )
    low = ideal(block, gas | {"p": np.full(block.cells, 3e5)})
    gauge = foam.write(tmp_path / "g", block, gas=low | {"p": low["p"] - 101325.0}, cloud=cloud)
    remarks = " ".join(read(gauge).remarks)
    assert "1.987e+05 to 1.987e+05 Pa): p seems to be a gauge pressure" in remarks


def test_a_case_in_millimetres(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    large = foam.block((5e3 * block.edges[0], 5e3 * block.edges[1], 5e3 * block.edges[2]))
    case = foam.write(tmp_path, large, gas=gas, cloud=cloud | {"position": 5e3 * cloud["position"]})
    refused(case, "m wide; allowed: up to 10 m .*metres")


def test_a_box_in_centimetres(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    large = foam.block((100 * block.edges[0], 100 * block.edges[1], 100 * block.edges[2]))
    path = save(tmp_path / "gas.vtu", block_grid(large, gas))
    refused(
        path,
        r"kg of vapour; allowed: up to 0\.1 kg .*such as cm",
        nozzle_m=(0.05, 0.9, 0.01),
        axis="-y",
    )


def test_times_that_differ_in_the_last_digit(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    for name, time in (("a", "0.001"), ("b", "0.0010000000000000002")):
        own = foam.block((block.edges[0] + 0.1 * (name == "b"), block.edges[1], block.edges[2]))
        save(tmp_path / f"{name}.vtu", block_grid(own, gas))
        pvd(tmp_path / f"{name}.pvd", {time: [f"{name}.vtu"]})
    refused(tmp_path, "2 claim to be the mesh of the gas", cloud="none")


def octane(folder: Path) -> CfdSpray:
    case = foam.case(folder, gas={"C7H16": None, "IC8H18": foam.sample()[1]["C7H16"]})
    return CfdSpray(file=case, fuel_field="IC8H18", **FRAME)


def test_the_fuel_of_a_stored_spray(tmp_path: Path) -> None:
    spec = octane(tmp_path / "case")
    stored = tmp_path / "spray.npz"
    assert imported(spec, stored).fuel == "iso-octane"
    again = read_cfd(CfdSpray(file=stored))
    assert again.fuel == "iso-octane"
    with pytest.raises(SprayError, match=r"fuel_field: n-octane; the file contains iso-octane"):
        read_cfd(CfdSpray(file=stored, fuel_field="NC8H18"))
    scene = load_scene("gdi-cone").model_copy(update={"spray": CfdSpray(file=stored)})
    with pytest.raises(OpticsError, match="iso-octane: no vapour absorption is shipped"):
        vapour_of(scene, again)
    only = load_scene("gdi-cone").optics.model_copy(update={"vapour": "methane"})
    liquid = liquid_of(scene.model_copy(update={"optics": only}), again)
    assert liquid is not None and liquid.name == "iso-octane"


def test_constants_of_n_heptane_are_for_n_heptane(tmp_path: Path) -> None:
    spec = octane(tmp_path / "case")
    spray = read_cfd(spec)
    scene = load_scene("gdi-cone").model_copy(update={"spray": spec})
    with pytest.raises(OpticsError, match=r"optics\.n, .*vapour_m2_mol: .* fuel is iso-octane"):
        wavelengths(scene, spray, cache=None)
    own = {"n": 1.39, "k": 0.03, "vapour_m2_mol": 60.0}
    given = scene.optics.model_copy(update=own)
    wavelengths(scene.model_copy(update={"optics": given}), spray, cache=None)
    fitted = tmp_path / "fit.yaml"
    fitted.write_text(fitted_scene(spec, spray, name="fit"))
    again = load_scene(fitted)
    assert again.optics.preset == "spectral"
    assert isinstance(again.spray, CfdSpray) and fuel_of(again.spray) == "iso-octane"


def test_a_resolved_scene_keeps_the_mass_of_the_fuel(tmp_path: Path) -> None:
    """A resolved scene has all keys, n-heptane's molar mass among them."""
    spec = octane(tmp_path / "case")
    scene = load_scene("gdi-cone").model_copy(update={"spray": spec})
    again = parse_scene(scene.model_dump(mode="json"), source="scene").spray
    assert isinstance(again, CfdSpray)
    vapour = read_cfd(again).vapour
    assert vapour is not None and vapour.molar_mass_kg_mol == pytest.approx(0.114232, rel=1e-5)


def test_a_name_that_is_no_formula() -> None:
    case = Path("case")
    assert fuel_of(CfdSpray(file=case, fuel_field="Y_FUEL")) == "n-heptane"
    other = CfdSpray(file=case, fuel_field="Y_FUEL", fuel_molar_mass_kg_mol=0.17)
    assert fuel_of(other) == "Y_FUEL"
    for name in ("N-C7H16", "Y(NC7H16)", "YC7H16", "X_NC7H16", "MASSFRAC_C7H16"):
        assert fuel_of(CfdSpray(file=case, fuel_field=name)) == "n-heptane"
    assert fuel_of(CfdSpray(file=case, fuel_field="C12H26")) == "C12H26"
    names = ["c7h16", "Y_C7H16", "MASSFRAC_C7H16", "MASSFRAC_IC8H18", "Y_C12H26", "CH4", "T"]
    assert other_fuels(names, "C7H16") == ["MASSFRAC_IC8H18", "Y_C12H26"]


@pytest.mark.parametrize("share", [0.5, 1e-3])
def test_two_fuels(tmp_path: Path, share: float) -> None:
    other = {"IC8H18": share * foam.sample()[1]["C7H16"], "C2H4": 0.01}
    spec = CfdSpray(file=foam.case(tmp_path, gas=other), **FRAME)
    if share > 0.1:
        with pytest.raises(SprayError, match=r"two fuels: C7H16, up to .* and IC8H18, up to"):
            read_cfd(spec)
    else:
        assert "Other fuels, not read: C2H4, IC8H18." in read_cfd(spec).remarks


def test_two_fuels_of_a_table(tmp_path: Path) -> None:
    """The mapping file names one of the columns of fuels."""
    path = write_tables(tmp_path, foam.sample())
    mapping = yaml.safe_load(path.read_text())
    table = tmp_path / mapping["cells"]["file"]
    first, head, *rows = table.read_text().splitlines()
    text = [first, f"{head},NC12H26", *(f"{row},5.0" for row in rows), ""]
    table.write_text("\n".join(text))
    refused(path, r"two fuels: C7H16, up to .* and NC12H26, up to 0.05")


def test_a_dummy_among_parcels_with_masses(tmp_path: Path) -> None:
    """Its mass cannot be divided by that of a droplet of no size."""
    path = write_tables(tmp_path, foam.sample())
    whole = notes_of(path)["parcels"]
    mapping = yaml.safe_load(path.read_text())
    given = mapping["parcels"]
    table = tmp_path / given["file"]
    rows = [row.split() for row in table.read_text().splitlines()]
    at = next(n for n, row in enumerate(rows) if given["radius"]["column"] in row)
    rows[at + 3][rows[at].index(given["radius"]["column"])] = "0"
    table.write_text("\n".join([*(" ".join(row) for row in rows), ""]))
    assert notes_of(path)["parcels"] == whole - 1
