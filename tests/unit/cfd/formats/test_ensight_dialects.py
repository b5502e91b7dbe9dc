"""EnSight as other programs write it: numbers elsewhere, undefined values, blocks, nodes, marks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.ensight.file import read_case_file
from cldit.errors import SprayError
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import Out, write_ensight
from tests.unit.cfd.reading import notes_of, read, refused

TIMES = "filename start number: 0\nfilename increment: 5\ntime values: 0.0005\n0.001\n"


@pytest.mark.parametrize(
    "text",
    [
        "filename start number: 0\nfilename increment: 5\ntime values:\n 0.0005 0.001 \n",
        "filename numbers: 0 5\ntime values:\n0.0005\n0.001\n",
        "filename numbers:\n0\n5\ntime values: 0.0005\n0.001\n",
        "filename numbers file: numbers.txt\ntime values file: times.txt\n",
    ],
)
def test_where_times_may_stand(tmp_path: Path, text: str) -> None:
    path = write_ensight(tmp_path, foam.sample(), binary=True)
    expected = notes_of(path)
    (tmp_path / "numbers.txt").write_text("0\n5\n")
    (tmp_path / "times.txt").write_text("0.0005 0.001\n")
    before = path.read_text()
    assert TIMES in before
    path.write_text(before.replace(TIMES, text))
    assert notes_of(path) == expected
    assert notes_of(path, time_s=0.0005)["vapour_mass_kg"] < expected["vapour_mass_kg"]


def test_negative_times_and_several_sets(tmp_path: Path) -> None:
    """Crank angles, and parcels with a time set of their own."""
    path = write_ensight(tmp_path, foam.sample(), binary=True)
    expected = notes_of(path)
    angles = TIMES.replace("0.0005\n0.001", "-345.5\n12.25")
    text = path.read_text().replace(TIMES, angles)
    text = text.replace("measured: 1 ", "measured: 2 ").replace("node: 1 ", "node: 2 ")
    path.write_text(text + "time set: 2\nnumber of steps: 2\n" + angles)
    assert notes_of(path)["time_s"] == 12.25
    assert notes_of(path, time_s=12.25)["liquid_mass_kg"] == expected["liquid_mass_kg"]
    assert notes_of(path, time_s=-345.5)["vapour_mass_kg"] < expected["vapour_mass_kg"]


def test_parcels_are_written_at_other_times(tmp_path: Path) -> None:
    """The last time of all files is not one at which the gas is written."""
    path = write_ensight(tmp_path, foam.sample(), binary=True)
    expected = notes_of(path)
    text = path.read_text().replace("measured: 1 ", "measured: 2 ").replace("node: 1 ", "node: 2 ")
    more = "number of steps: 3\nfilename numbers: 0 5 5\ntime values: 0.0005 0.0010000001 0.002\n"
    path.write_text(f"{text}time set: 2\n{more}")
    assert notes_of(path) == notes_of(path, time_s="nearest 0.002") == expected
    path.write_text(f"{text}time set: 2\n{more}".replace("0.0005 0.0010000001", "0.0006 0.0011"))
    refused(path, r"no time at .*: C7H16 at 0\.0005, 0\.001; .*parcels'")
    assert notes_of(path, cloud="none")["vapour_mass_kg"] == expected["vapour_mass_kg"]


def field(file: Path, values: Any, binary: bool, mode: str, left_out: Any) -> None:
    """A field per element of which some values are undefined, or not written."""
    out = Out(file, binary)
    out.text("fuel")
    out.text("part")
    out.integers(1)
    out.text(f"hexa8 {mode}")
    given = np.setdiff1d(np.arange(len(values)), left_out)
    if mode == "undef":
        out.floats([-1e20])
        marked = values.copy()
        marked[left_out] = -1e20
        out.floats(marked)
    else:
        out.integers([len(given)])
        out.integers(given + 1)
        out.floats(values[given])
    out.save()


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("mode", ["undef", "partial"])
def test_undefined_values_are_the_users_to_name(tmp_path: Path, mode: str, binary: bool) -> None:
    block, gas, _ = sample = foam.sample()
    path = write_ensight(tmp_path, sample, binary=binary)
    none = np.array([2, 9, 10])
    field(tmp_path / "case.005.C7H16", gas["C7H16"], binary, mode, none)
    refused(path, r"3 of 24 values are marked as undefined \(cells.fuel\)")
    mapping = tmp_path / "names.yaml"
    mapping.write_text("cells: {fuel: {column: C7H16, undefined: 0}}")
    kept = np.setdiff1d(np.arange(block.cells), none)
    mass = np.sum((gas["rho"] * gas["C7H16"] * block.volume)[kept])
    slack = 5e-6 if binary else 5e-5  # float32, or six digits
    assert notes_of(path, mapping=mapping)["vapour_mass_kg"] == pytest.approx(mass, rel=slack)
    field(tmp_path / "case.005.T", gas["T"], binary, mode, none)
    refused(path, r"005\.T: field T: 3 of 24 .* \(cells.temperature\)", mapping=mapping)


@pytest.mark.parametrize("kind", ["curvilinear", "rectilinear", "uniform"])
@pytest.mark.parametrize("binary", [True, False])
def test_blocks_and_blanked_cells(tmp_path: Path, kind: str, binary: bool) -> None:
    """A structured part; its blanked corner takes the cells that have it away."""
    edges = tuple(np.linspace(-2e-3, 4e-3, count + 1) for count in (3, 4, 2))
    block = foam.block((edges[0], edges[1] + 2e-3, edges[2]))
    _, gas, cloud = foam.sample()
    inside = cloud | {"position": np.full((17, 3), 1e-3)}
    path = write_ensight(tmp_path, (block, gas, inside), binary=binary)
    geo = Out(tmp_path / "case.geo", binary, head=True)
    for line in ("a block", "of cells", "node id off", "element id off", "part"):
        geo.text(line)
    geo.integers(1)
    geo.text("internal")
    geo.text(f"block {kind} iblanked")
    geo.integers([4, 5, 3], a_line=3)
    if kind == "curvilinear":
        geo.floats(block.points.T)
    elif kind == "rectilinear":
        for edge in block.edges:
            geo.floats(edge)
    else:
        geo.floats([edge[0] for edge in block.edges])
        geo.floats([edge[1] - edge[0] for edge in block.edges])
    blank = np.ones(60, dtype=int)
    blank[0] = 0
    geo.integers(blank)
    geo.save()
    for name, values in gas.items():
        Out(tmp_path / f"case.005.{name}", binary).variable(name, (1, "block", values))
    found = read(path)
    mass = np.sum((gas["rho"] * gas["C7H16"] * block.volume)[1:])
    assert found.notes["vapour_mass_kg"] == pytest.approx(mass, rel=5e-5)
    assert found.notes["gas_cells"] == 23
    assert "Ghost or blanked cells omitted: 1." in found.remarks


def test_values_at_nodes(tmp_path: Path) -> None:
    """Of a linear function of place in boxes, the mean over corners is the value in the middle."""
    block, gas, _ = sample = foam.sample()
    path = write_ensight(tmp_path, sample, binary=True)
    expected = notes_of(path)
    text = path.read_text()
    for name, values in (("T", gas["T"]), ("rho", gas["rho"])):
        text = text.replace(f"scalar per element: 1 {name} ", f"scalar per node: 1 {name} ")
        at_nodes = values[0] * (1.0 + 20.0 * block.points[:, 0])
        Out(tmp_path / f"case.005.{name}", True).variable(name, (1, "coordinates", at_nodes))
    path.write_text(text)
    found = read(path)
    density = gas["rho"][0] * (1.0 + 20.0 * block.centre[:, 0])
    mass = np.sum(density * gas["C7H16"] * block.volume)
    assert found.notes["vapour_mass_kg"] == pytest.approx(mass, rel=5e-6)
    assert found.notes["liquid_mass_kg"] == expected["liquid_mass_kg"]
    assert any("rho at nodes became means over cells" in text for text in found.remarks)


def test_names_of_foam_to_ensight(tmp_path: Path) -> None:
    """Fields c0d, c0T .. in the folder of their cloud; a second cloud is a choice."""
    path = write_ensight(tmp_path, foam.sample(), binary=True)
    expected = notes_of(path)
    text = path.read_text().replace("case.***.mgeo", "***/lagrangian/rain/positions")
    for name in ("d", "nParticle", "T", "rho", "U"):
        text = text.replace(f"{name} case.***.m_{name}", f"c0{name} ***/lagrangian/rain/{name}")
    path.write_text(text)
    for number in ("000", "005"):
        folder = tmp_path / number / "lagrangian" / "rain"
        folder.mkdir(parents=True)
        (tmp_path / f"case.{number}.mgeo").rename(folder / "positions")
        for name in ("d", "nParticle", "T", "rho", "U"):
            (tmp_path / f"case.{number}.m_{name}").rename(folder / name)
    assert notes_of(path) == expected
    assert notes_of(path, cloud="rain") == expected
    assert "parcels" not in notes_of(path, cloud="none")
    lines = [line for line in path.read_text().splitlines() if "lagrangian/rain" in line]
    more = "\n".join(line.replace("rain", "fog").replace("c0", "c1") for line in lines[1:])
    measured = lines[0].replace("rain", "fog")
    text = path.read_text().replace(lines[0], f"{lines[0]}\n{measured}")
    path.write_text(text.replace(lines[-1], f"{lines[-1]}\n{more}"))
    refused(path, "several clouds: fog, rain")
    assert notes_of(path, cloud="rain") == expected


def test_two_cases_in_a_folder(tmp_path: Path) -> None:
    path = write_ensight(tmp_path, foam.sample(), binary=True)
    assert notes_of(tmp_path) == notes_of(path)
    (tmp_path / "more.encas").write_text(path.read_text())
    refused(tmp_path, r"2 claim to be the EnSight case: .*\.case, .*\.encas")


@pytest.mark.parametrize("key", ["filename increment", "number of steps", "filename numbers"])
def test_a_number_of_many_digits_is_refused(tmp_path: Path, key: str) -> None:
    path = tmp_path / "a.case"
    text = f"FORMAT\ntype: ensight gold\nTIME\ntime set: 1\ntime values: 0\n{key}: {'9' * 4000}\n"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SprayError, match=r"a\.case: is no EnSight case file"):
        read_case_file(path)
