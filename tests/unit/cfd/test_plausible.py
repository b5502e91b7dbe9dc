"""Values that are possible one by one, in a unit that is not the expected one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, refused
from tests.unit.cfd.test_vtk import block_grid, save
from tests.unit.cfd.vtkfiles import pvd


def ideal(block: Any, gas: dict[str, Any]) -> dict[str, Any]:
    moles = gas["C7H16"] / 0.100204 + (1 - gas["C7H16"]) / 0.02885
    return gas | {"rho": gas["p"] / (moles * 8.314463 * gas["T"])}


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("T", lambda T: T - 273.15, r"sprayCloud/T: .* is outside 182\.6\.\.5000; .*degC"),
        ("nParticle", lambda n: n * 1e-9, "droplets in 17 parcels; .* names it as `mass`"),
        ("nParticle", lambda n: n * 1e9, "kg of liquid; allowed: up to 0.01 kg"),
    ],
)
def test_parcels_in_another_unit(tmp_path: Path, name: str, change: Any, message: str) -> None:
    block, gas, cloud = foam.sample()
    case = foam.write(tmp_path, block, gas=gas, cloud=cloud | {name: change(cloud[name])})
    refused(case, message)


def test_the_liquid_of_a_fuel_without_a_formula_is_n_heptane(tmp_path: Path) -> None:
    block, gas, cloud = foam.sample()
    own = {name: values for name, values in gas.items() if name != "C7H16"}
    cold = cloud | {"T": cloud["T"] - 273.15}
    case = foam.write(tmp_path, block, gas=own | {"Y_FUEL": gas["C7H16"]}, cloud=cold)
    refused(case, r"T: .* is outside 182\.6\.\.5000", fuel_field="Y_FUEL")


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


@pytest.mark.parametrize(("name", "factor"), [("rho", 1e-3), ("p", 1e-5)])
def test_a_density_that_is_no_ideal_gas(tmp_path: Path, name: str, factor: float) -> None:
    _, gas, _ = foam.sample()
    case = foam.case(tmp_path, gas=gas | {name: factor * gas[name]})
    refused(case, "one of them is not in kg/m3, K, Pa")


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
