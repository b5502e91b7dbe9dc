"""Kinds of wrong cases, each told by values and relations, under names that no list has."""

from __future__ import annotations

import os
from pathlib import Path
from time import time as now
from typing import Any

import numpy as np
import pytest

from cldit.cfd.case import Cloud, Column
from cldit.cfd.formats import read_case
from cldit.cfd.importing import cfd_spray
from cldit.cfd.one_state import check_parcels
from cldit.cfd.plausible import check_one_liquid
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_converge
from tests.unit.cfd.reading import notes_of, read, refused
from tests.unit.cfd.vtkfiles import block_grid, cloud_data, pvd, save, vtk_array

SET: dict[str, Any] = {"nozzle_m": (0.0, 0.0, 0.0), "axis": "+z"}
MANY = 200


def jet(seed: int = 1) -> dict[str, Any]:
    """Parcels on straight ways from the origin, each with its own age, size and droplets."""
    random = np.random.default_rng(seed)
    age = random.uniform(2e-5, 5e-4, MANY)
    velocity = random.normal((0.0, 0.0, 60.0), (4.0, 4.0, 5.0), (MANY, 3))
    return {
        "position": velocity * age[:, None],
        "U": velocity,
        "age": age,
        "d": random.uniform(5e-6, 3e-5, MANY),
        "nParticle": random.uniform(500.0, 4000.0, MANY),
        "T": random.uniform(340.0, 400.0, MANY),
        "rho": random.uniform(600.0, 650.0, MANY),
    }


def at_times(parcels: dict[str, Any], shares: tuple[float, ...]) -> dict[str, Any]:
    """The same parcels at several ages; droplets that have lost some of their size on the way."""
    parts = []
    for share in shares:
        moved = {"position": share * parcels["position"], "age": share * parcels["age"]}
        parts.append(parcels | moved | {"d": parcels["d"] * (1.0 - 0.05 * share)})
    return {key: np.concatenate([part[key] for part in parts]) for key in parcels}


def cloud(parcels: dict[str, Any], **others: Any) -> Cloud:
    columns = {key: Column(f"file: {key}", values) for key, values in parcels.items()}
    more = {key: Column(f"file: {key}", np.asarray(values)) for key, values in others.items()}
    return Cloud("spray", columns.pop("position"), columns, more)


def without(parcels: dict[str, Any], *names: str) -> dict[str, Any]:
    return {key: values for key, values in parcels.items() if key not in names}


@pytest.mark.parametrize("lacking", [(), ("age",), ("U",), ("age", "U")])
@pytest.mark.parametrize("name", ["origId", "Kennung", "p0"])
def test_tracks_by_a_column_of_identities(name: str, lacking: tuple[str, ...]) -> None:
    rows = without(at_times(jet(), (0.2, 0.4, 0.6, 0.8, 1.0)), *lacking)
    mark = np.tile(np.arange(MANY), 5)
    with pytest.raises(SprayError, match=rf"file: {name}: 200 values in 1000 rows, and rows of on"):
        check_parcels(cloud(rows, **{name: mark}))


def test_tracks_that_begin_at_different_times_recur_unequally_often() -> None:
    rows = at_times(jet(), (0.2, 0.4, 0.6, 0.8, 1.0))
    late = np.random.default_rng(3).random(len(rows["d"])) < 0.7
    mark = np.tile(np.arange(MANY), 5)[late]
    with pytest.raises(SprayError, match="rows of one value seem to be one parcel"):
        check_parcels(cloud({k: v[late] for k, v in rows.items()}, number=mark))


@pytest.mark.parametrize("lacking", [(), ("age",)])
def test_two_times_without_any_mark_have_each_number_of_droplets_twice(
    lacking: tuple[str, ...],
) -> None:
    rows = without(at_times(jet(), (0.5, 1.0)), *lacking)
    rows["nParticle"] = rows["nParticle"] * rows["d"] ** 3 / rows["d"] ** 3  # of a column of masses
    with pytest.raises(SprayError, match=r"file: nParticle: 2\d\d values in 400 rows"):
        check_parcels(cloud(rows))


def test_columns_that_recur_but_do_not_tell_parcels_apart() -> None:
    """Cells, processors, holes and steps of the injection, some of them equally often."""
    random = np.random.default_rng(5)
    every = np.arange(MANY)
    columns = {
        "cell": np.floor(jet()["position"][:, 2] / 2e-4),
        "processor": random.integers(0, 16, MANY),
        "hole": every % 8,
        "class": every % 25,
        "typeId": np.ones(MANY),
        "active": random.integers(0, 2, MANY),
        "T0": np.where(every % 2, 330.0, 340.0),
    }
    for name, values in columns.items():
        check_parcels(cloud(jet(), **{name: values}))
        check_parcels(cloud(without(jet(), "age"), **{name: values}))


def test_parcels_injected_together_are_no_tracks() -> None:
    """Eight holes, or one; a batch has one age, or one within a step; equal droplets in each."""
    random = np.random.default_rng(6)
    for holes, within in ((8, 0.0), (1, 0.3)):
        step = np.repeat(np.arange(50), 8)
        age = (50 - step) * 1e-5 - within * 1e-5 * np.tile(np.arange(8), 50)
        angle = 2 * np.pi * np.tile(np.arange(8), 50) / 8
        wide = 20.0 if holes == 8 else 0.0
        speed = random.normal(60.0, 2.0, 400)
        way = np.stack([wide * np.cos(angle), wide * np.sin(angle), speed], axis=1)
        size = 2e-5 - 1e-9 * (50 - step)
        rows = {"position": way * age[:, None], "U": way, "age": age, "d": size}
        rows |= {"nParticle": 1000.0 + 7.3 * step, "T": 350 + 0 * age, "rho": 620 + 0 * age}
        check_parcels(cloud(rows))


@pytest.mark.parametrize("total", ["sum", "mass"])
def test_a_last_row_that_sums_up_the_others(total: str) -> None:
    rows = {
        key: np.concatenate([v, v.mean(axis=0)[None] if v.ndim == 2 else [v.mean()]])
        for key, v in jet().items()
    }
    rows["nParticle"][-1] = rows["nParticle"][:-1].sum() * (1.0 if total == "sum" else 0.37)
    with pytest.raises(SprayError, match=r"nParticle: row 200 \(.*it seems to be a summary"):
        check_parcels(cloud(rows))


def test_a_blob_that_has_most_of_the_liquid_is_no_summary() -> None:
    rows = jet()
    rows["d"][0], rows["nParticle"][0] = 9e-5, 3000.0
    check_parcels(cloud(rows))


def gas(shape: tuple[int, int, int], low: Any, high: Any, **more: Any) -> Any:
    """A uniform grid of vtk's, of cells with fuel everywhere."""
    edges = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, shape, strict=True)]
    block = foam.block((edges[0], edges[1], edges[2]))
    fields = {"T": 700.0, "p": 5e6, "rho": 26.0, "C7H16": 0.1} | more
    return block, {key: np.full(block.cells, float(value)) for key, value in fields.items()}


def appended(tmp_path: Path, *parts: tuple[Any, dict[str, Any]], turn_deg: float = 0.0) -> Path:
    """One file of several blocks, all turned about z."""
    from vtkmodules.vtkCommonTransforms import vtkTransform
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersGeneral import vtkTransformFilter

    both = vtkAppendFilter()
    for block, fields in parts:
        both.AddInputData(block_grid(block, fields))
    turn = vtkTransform()
    turn.RotateZ(turn_deg)
    turned = vtkTransformFilter()
    turned.SetInputConnection(both.GetOutputPort())
    turned.SetTransform(turn)
    turned.Update()
    return save(tmp_path / "gas.vtu", turned.GetOutput())


@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_coarse_cells_beside_the_finer_ones_that_cover_them(
    tmp_path: Path, turn_deg: float
) -> None:
    """In a corner of a domain that does not fill its box, so that no total is too large."""
    whole = gas((6, 6, 6), (-6e-3, -6e-3, 0.0), (6e-3, 6e-3, 12e-3))
    apart = gas((4, 4, 4), (30e-3, 30e-3, 30e-3), (38e-3, 38e-3, 38e-3))
    fine = gas((4, 4, 4), (-2e-3, -2e-3, 0.0), (2e-3, 2e-3, 4e-3))
    read(appended(tmp_path, whole, apart, turn_deg=turn_deg), **SET)
    refused(
        appended(tmp_path, whole, apart, fine, turn_deg=turn_deg),
        "8 cells with fuel are covered by others",
        **SET,
    )


@pytest.mark.parametrize("turn_deg", [0.0, 30.0])
def test_a_run_in_two_dimensions(tmp_path: Path, turn_deg: float) -> None:
    flat = gas((10, 1, 12), (-6e-3, -1e-3, 0.0), (6e-3, 1e-3, 12e-3))
    refused(
        appended(tmp_path, flat, turn_deg=turn_deg),
        r"its cells form one layer, 0\.00\d+ m thick along",
        **SET,
    )
    thick = gas((10, 2, 12), (-6e-3, -1e-3, 0.0), (6e-3, 1e-3, 12e-3))
    read(appended(tmp_path, thick, turn_deg=turn_deg), **SET)


def test_gas_and_parcels_that_state_different_times(tmp_path: Path) -> None:
    block, fields = gas((6, 6, 16), (-8e-3, -8e-3, 0.0), (8e-3, 8e-3, 50e-3))
    for file, data, time in (
        ("a.vtu", block_grid(block, fields), 1e-3), ("b.vtp", cloud_data(jet()), 5e-4)
    ):  # fmt: skip
        data.GetFieldData().AddArray(vtk_array("TimeValue", np.array([time])))
        save(tmp_path / file, data)
    refused(
        tmp_path,
        r"b\.vtp: states the time 0\.0005.*a\.vtu the time 0\.001",
        parcels_left_out=0.1,
        **SET,
    )
    read(tmp_path, cloud="none", **SET)


def commented(text: str, random: np.random.Generator) -> str:
    """A comment after some of the lines, at each place where OpenFOAM's grammar allows one."""
    notes = ("// internalField uniform 0.01;", "/* 7 ( 1 2 ) \n 3 */", "// 5", '/* "a;b{ */ // (')
    lines = []
    for line in text.splitlines():
        some = random.random() < 0.2 and "//" not in line
        comment = notes[random.integers(0, 4)] if some else ""
        lines.append(f"{line} {comment}" if random.random() < 0.5 else f"{comment}\n{line}")
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("binary", [False, True])
def test_commented_variants_of_a_case_give_one_spray(tmp_path: Path, binary: bool) -> None:
    case = foam.case(tmp_path, form=foam.form(binary=binary))
    whole = notes_of(case)
    files = [each for each in case.rglob("*") if each.is_file() and each.name != "controlDict"]
    bodies = {file: file.read_bytes() for file in files}
    random = np.random.default_rng(4)
    for _ in range(5 if binary else 20):
        for file, body in bodies.items():
            mark = b"internalField" if b"internalField" in body else b"// * *"
            head, mark, rest = body.partition(mark if binary else b"no mark")
            text = commented(head.decode("latin-1"), random).encode("latin-1")
            file.write_bytes(text + mark + rest)
        assert notes_of(case) == whole


@pytest.mark.parametrize(
    "text",
    [
        "T0 690; dimensions [0 0 0 1 0 0 0]; internalField uniform $T0;",
        "hot { T 1; internalField uniform 5; } a $b; b 690; internalField uniform ${:b};",
        '#include "start"\ninternalField uniform $T1;',
        'walls { internalField uniform 4; }\n#include "start"\ninternalField $whole;',
        '#include "$FOAM_CASE/none"\ninternalField uniform 690;',
    ],
)
def test_macros_and_includes_of_a_field(tmp_path: Path, text: str) -> None:
    case = foam.case(tmp_path, gas={"rho": 25.0}, cloud=False)
    (case / "0.001/start").write_text("/* T1 1; */ T1 690; // T1 2;\nwhole uniform $T1;\n")
    foam.form().write(case / "0.001/T", "volScalarField", text.encode())
    notes = notes_of(case)
    assert notes["gas_temperature_min_K"] == notes["gas_temperature_max_K"] == 690.0


BOX = ((6, 6, 16), (-8e-3, -8e-3, 0.0), (8e-3, 8e-3, 50e-3))


def vtu(tmp_path: Path, lacking: str = "", **fields: float) -> Path:
    block, known = gas(*BOX)
    known |= {name: np.full(block.cells, value) for name, value in fields.items()}
    return appended(tmp_path, (block, {k: v for k, v in known.items() if k != lacking}))


@pytest.mark.parametrize("name", ["X_C7H16", "Mole Fraction of C7H16", "molef-c7h16", "MOLF_FUEL"])
def test_mole_fractions_become_mass_fractions(tmp_path: Path, name: str) -> None:
    """Exact: x W / (x W + (1 - x) W_air); the fields of a VTK file are float32."""
    mole = 0.05
    mass = mole * 0.100204 / (mole * 0.100204 + (1.0 - mole) * 0.02885)
    whole = notes_of(vtu(tmp_path, C7H16=mass), **SET)
    path = vtu(tmp_path, "C7H16", **{name: mole})
    found = read(path, fuel_field=name, **SET)
    assert found.notes["vapour_mass_kg"] == pytest.approx(whole["vapour_mass_kg"], rel=1e-6)
    assert any("mole fractions of fuel in air" in remark for remark in found.remarks)


@pytest.mark.parametrize("name", ["Molar Concentration of C7H16", "partial_pressure_C7H16"])
def test_fuel_as_another_quantity(tmp_path: Path, name: str) -> None:
    path = vtu(tmp_path, "C7H16", **{name: 0.1})
    refused(
        path, r"cells\.fuel: unit 'concentration or partial pressure' is", fuel_field=name, **SET
    )


def test_gauge_pressure_without_a_density(tmp_path: Path) -> None:
    path = vtu(tmp_path, "rho", p=900.0)
    refused(path, r"field p: 900 \(entry 0\) is outside 10000\.\..*gauge", **SET)
    mapping = tmp_path / "m.yaml"
    mapping.write_text("cells: {pressure: {column: p, unit: Pa absolute}}")
    read(path, mapping=mapping, **SET)
    found = read(vtu(tmp_path, "rho"), **SET)
    assert any("at T and p (5e+06 to 5e+06 Pa) was used" in remark for remark in found.remarks)
    path = vtu(tmp_path, "rho", **{"Gauge Pressure": 5e6})
    mapping.write_text("cells: {pressure: Gauge Pressure}")
    refused(path, "unit 'Pa gauge' is unknown; allowed: Pa, kPa", mapping=mapping, **SET)


@pytest.mark.parametrize(
    "names",
    [
        ("C7H16(l)", "H2O(l)"),
        ("massfrac_heptane", "massfrac_water"),
        ("LIQ_MFRAC_NC7H16", "LIQ_MFRAC_IC8H18"),
        ("other", "IC8H18(l)"),
    ],
)
def test_parcels_of_two_liquids(names: tuple[str, str]) -> None:
    shares = {name: np.full(MANY, share) for name, share in zip(names, (0.7, 0.3), strict=True)}
    with pytest.raises(
        SprayError, match=r"file: .*: parcels of .*; allowed: parcels of C7H16 alone"
    ):
        check_one_liquid(cloud(jet(), **shares), "C7H16")


def test_shares_that_are_no_second_liquid() -> None:
    whole, half = np.ones(MANY), np.full(MANY, 0.5)
    for shares in (
        {"C7H16(l)": whole, "Yliquid": whole, "Ygas": 0 * whole},
        {"MASSFRAC_C7H16": 0.1 * whole, "MASSFRAC_O2": 0.2 * whole, "MASSFRAC_N2": 0.7 * whole},
        {"C7H16(l)": whole, "H2O(l)": 1e-4 * whole},
        {"C7H16": half, "evaporated": half},
        {"nHeptane(l)": whole},
        {"NC7H16(l)": whole},
    ):
        check_one_liquid(cloud(jet(), **shares), "C7H16")
    for fuel in ("Y_FUEL", "NC7H16"):
        check_one_liquid(cloud(jet(), **{"C7H16(l)": whole}), fuel)
    with pytest.raises(SprayError, match=r"parcels of C12H26 \(up to 1\); allowed: parcels of C7"):
        check_one_liquid(cloud(jet(), **{"C12H26(l)": whole}), "C7H16")


def test_times_of_a_collection_that_go_back_are_reported(tmp_path: Path) -> None:
    for name in ("new", "old"):
        save(tmp_path / f"{name}.vtu", block_grid(*gas(*BOX)))
    path = pvd(tmp_path / "case.pvd", {"1e-3": ["new.vtu"], "1.2e-3": ["old.vtu"]})
    assert "go back" not in " ".join(read(path, **SET).remarks)
    path = pvd(tmp_path / "case.pvd", {"1.2e-3": ["old.vtu"], "1e-3": ["new.vtu"]})
    remarks = " ".join(read(path, **SET).remarks)
    assert "its times go back from 0.0012 to 0.001" in remarks


def test_a_check_that_is_accepted_is_a_remark_and_the_others_hold(tmp_path: Path) -> None:
    whole = gas(*BOX)
    fine = gas((4, 4, 4), (-16e-3 / 3, -16e-3 / 3, 0.0), (0.0, 0.0, 6.25e-3))
    path = appended(tmp_path, whole, fine)
    mapping = tmp_path / "m.yaml"
    mapping.write_text("accept: [tracks]")
    message = r"covered by others.*`--accept cells` \(spray\.accept: \[cells\]\) reads it all the"
    refused(path, message, mapping=mapping, **SET)
    mapping.write_text("accept: [cells]")
    remarks = read(path, mapping=mapping, **SET).remarks
    assert any(each.startswith("Accepted (cells): ") for each in remarks)
    assert read(path, accept=("tracks", "cells"), **SET).remarks == remarks
    mapping.write_text("accept: [all]")
    allowed = "'all' is unknown; allowed: 'times', 'copies', 'tracks'"
    refused(path, rf"m\.yaml: accept: {allowed}", mapping=mapping, **SET)
    with pytest.raises(SprayError, match=rf"^accept: {allowed}"):
        cfd_spray({"file": path, "accept": ["all"]})


def test_a_check_that_cannot_decide_names_what_it_needs(tmp_path: Path) -> None:
    for kept in (True, False):
        case = foam.case(tmp_path / str(kept), cloud={} if kept else {"U": None})
        remarks = read(case, nozzle_m=(0.0, 0.0, 0.0), axis="+y").remarks
        said = [each for each in remarks if each.startswith("Not checked (tracks): ")]
        assert len(said) == (0 if kept else 1)
        assert kept or "positions: needs velocities, ages, or a number of each parcel" in said[0]


def test_units_in_a_vtk_file(tmp_path: Path) -> None:
    from vtkmodules.vtkCommonCore import vtkDataArray

    for unit, factor in (("kPa", 1e-3), ("bar", 1e-5)):
        block, fields = gas(*BOX)
        data = block_grid(block, fields | {"p": fields["p"] * factor})
        data.GetCellData().GetArray("p").GetInformation().Set(vtkDataArray.UNITS_LABEL(), unit)
        del fields["rho"]
        data.GetCellData().RemoveArray("rho")
        found = read(save(tmp_path / "gas.vtu", data), **SET)
        assert any("T and p (5e+06 to 5e+06 Pa)" in remark for remark in found.remarks)
    data.GetCellData().GetArray("p").GetInformation().Set(vtkDataArray.UNITS_LABEL(), "m2/s2")
    refused(save(tmp_path / "gas.vtu", data), "unit 'm2/s2' is unknown; allowed: Pa", **SET)


def test_units_of_hdf_arrays(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = write_converge(tmp_path, foam.sample(), new=True)
    file = next(each for each in [path, *path.rglob("*.h5")] if each.is_file())
    whole = notes_of(file)
    with h5py.File(file, "a") as post:
        pressure = post["STREAM_00/CELL_CENTER_DATA/PRESSURE"]
        pressure[...] = pressure[()] / 1e5
        pressure.attrs["Units"] = "bar"
    assert notes_of(file) == pytest.approx(whole, rel=1e-6)


def test_a_file_that_changes_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = vtu(tmp_path)

    def touched(spec: CfdSpray, *more: Any) -> Any:
        os.utime(path, (now(), now()))
        return read_case(spec, *more)

    monkeypatch.setattr("cldit.cfd.to_spray.read_case", touched)
    refused(path, r"gas\.vtu: changed while it was read", **SET)
