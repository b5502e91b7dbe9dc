"""A case is one state: every cell and parcel once, one time of those that a series has."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.case import choose_times
from cldit.cfd.formats import read_case
from cldit.cfd.openfoam.file import read_foam
from cldit.cfd.openfoam.lists import scalars, vectors
from cldit.cfd.orientation import find_frame, with_one_frame
from cldit.cfd.to_spray import read_cfd
from cldit.errors import EmptyCloud, NoFuel, NotAtThisTime, SprayError
from cldit.scene.spray import CfdSpray
from cldit.scene.values import time_of
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, read, refused
from tests.unit.cfd.seriescases import NOZZLE, write_times
from tests.unit.cfd.vtkfiles import block_grid, pieces, save

CLOUD = "0.001/lagrangian/sprayCloud"


def test_parcels_that_occur_twice(tmp_path: Path) -> None:
    cloud = foam.sample()[2]
    twice = {name: np.concatenate([values, values[3:5]]) for name, values in cloud.items()}
    case = foam.case(tmp_path / "one", cloud=twice)
    refused(case, r"positions: 2 of 19 parcels occur twice, such as parcels 3 and 17")
    read(foam.case(tmp_path / "two", cloud=twice | {"age": np.zeros(19)}))


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_cells_of_two_pieces_that_overlap(tmp_path: Path, shift: float) -> None:
    """Copies of cells have their centroids; cells of another grid contain some of the others."""
    block, gas, _ = foam.sample()
    width = float(block.edges[0][-1] - block.edges[0][0])
    moved = foam.block((block.edges[0] + 0.3 * shift * width, block.edges[1], block.edges[2]))
    for number, each in enumerate((block, moved)):
        more = {name: values + 1e-3 * number for name, values in gas.items()}
        save(tmp_path / f"gas_{number}.vtu", block_grid(each, more))
    path = pieces(tmp_path / "gas.pvtu", ["gas_0.vtu", "gas_1.vtu"])
    refused(path, "covered by others, where" if shift else r"gas_1.vtu: 24 cells with fuel lie")


def test_halo_cells(tmp_path: Path) -> None:
    """Two processors share a layer of cells that no mark tells."""
    block, gas, _ = foam.sample()
    parts = ((slice(0, 3), slice(0, 2)), (slice(1, 4), slice(1, 3)))
    for number, (points, layers) in enumerate(parts):
        own = foam.block((block.edges[0][points], block.edges[1], block.edges[2]))
        shape = block.shape[::-1]
        some = {k: v.reshape(shape)[:, :, layers].reshape(-1) for k, v in gas.items()}
        foam.write(tmp_path / f"processor{number}", own, gas=some)
    refused(tmp_path, r"processor1/constant/polyMesh: 8 cells with fuel lie where those of .*or0")


def test_a_processor_is_missing(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    for number in (0, 2):
        step = 0.1 * number
        own = foam.block((block.edges[0] + step, block.edges[1], block.edges[2]))
        foam.write(tmp_path / f"processor{number}", own, gas=gas)
    refused(tmp_path, "processor1 is missing")
    (tmp_path / "processor2").rename(tmp_path / "processor1")
    read(tmp_path)
    boundary = tmp_path / "processor1/constant/polyMesh/boundary"
    patch = "1\n(\nto2 { type processor; neighbProcNo 2; nFaces 1; startFace 0; }\n)\n"
    foam.form().write(boundary, "polyBoundaryMesh", patch.encode())
    refused(tmp_path, "processor2 is missing, which .*processor1/constant/polyMesh/boundary impl")


@pytest.mark.parametrize("binary", [False, True])
def test_an_empty_list_is_its_count_alone(tmp_path: Path, binary: bool) -> None:
    """As OpenFOAM writes lists of nothing in binary."""
    block, gas, cloud = foam.sample()
    form = foam.form(binary=binary)
    for number in (0, 1):
        own = foam.block((block.edges[0] + 0.1 * number, block.edges[1], block.edges[2]))
        foam.write(tmp_path / f"processor{number}", own, gas=gas, cloud=cloud, form=form)
    for name in (*cloud, "positions"):
        file = tmp_path / "processor1" / CLOUD / name
        if file.exists():
            kind = "vectorField" if name == "U" else "scalarField"
            form.write(file, "Cloud" if name == "positions" else kind, b"0")
    assert notes_of(tmp_path)["parcels"] == 17


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"/**/" * 40, "no list where one is expected"),
        (b" \n" * 200_000 + b"x", "no list where one is expected"),
        (b"1000000000000{1e-5}", "1000000000000 values for 17 parcels"),
        (b"9" * 5000 + b"(1)", "a list of 99999999999999999999... entries"),
    ],
)
def test_small_files_that_hang_or_grow(tmp_path: Path, body: bytes, message: str) -> None:
    case = foam.case(tmp_path)
    foam.form().write(case / CLOUD / "d", "scalarField", body)
    begin = time.monotonic()
    refused(case, message)
    assert time.monotonic() - begin < 20.0


def test_comments_without_an_end(tmp_path: Path) -> None:
    case = foam.case(tmp_path)
    head = b"injectionModel\n" + b"/* " * 300_000
    foam.form().write(case / "constant/sprayCloudProperties", "dictionary", head)
    begin = time.monotonic()
    refused(case, "brackets do not match")
    assert time.monotonic() - begin < 20.0
    deep = b"injectionModel " + b"a { " * 100_000
    foam.form().write(case / "constant/sprayCloudProperties", "dictionary", deep)
    refused(case, "brackets do not match")


def test_a_packed_field_of_blanks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = foam.case(tmp_path, form=foam.form(gz=True))
    foam.form(gz=True).write(case / "0.001/T", "volScalarField", b" " * 100_000_000)
    monkeypatch.setattr("cldit.cfd.inputs.free_bytes", lambda: 250_000_000)
    refused(case, r"T.gz: more than 0\.0\d+ GB of content; allowed: up to a third of the 0\.25 GB")


def late(folder: Path, *, youngest_s: float) -> Path:
    """Parcels that drag slows, the youngest of the given age."""
    random = np.random.default_rng(2)
    edges = [np.linspace(*span) for span in ((-0.02, 0.02, 9), (-0.02, 0.1, 9), (-0.02, 0.02, 9))]
    block = foam.block((edges[0], edges[1], edges[2]))
    age = random.uniform(youngest_s, youngest_s + 5e-4, 400)
    start = random.normal((0.0, 200.0, 0.0), 10.0, (400, 3))
    tau = random.uniform(1e-4, 4e-4, 400)
    cloud = {
        "position": start * (tau * (1 - np.exp(-age / tau)))[:, None],
        "U": start * np.exp(-age / tau)[:, None],
        "age": age,
        "d": random.uniform(5e-6, 2e-5, 400),
        "nParticle": np.full(400, 1e3),
        "T": np.full(400, 370.0),
        "rho": np.full(400, 610.0),
    }
    gas = {"T": 570.0, "p": 6e5, "rho": 3.6, "C7H16": 0.0}
    return foam.write(folder, block, gas=gas, cloud=cloud)


def test_the_nozzle_after_the_end_of_injection_is_asked_for(tmp_path: Path) -> None:
    ended = late(tmp_path / "ended", youngest_s=2e-4)
    refused(ended, r"the nozzle cannot be inferred .*set spray\.nozzle_m", nozzle_m=None, axis=None)
    spec = CfdSpray(file=late(tmp_path / "going", youngest_s=0.0))
    frame = find_frame(spec, read_case(spec))
    assert np.linalg.norm(frame.nozzle_m) < 1e-3
    assert np.array_equal(frame.axis, (0.0, 1.0, 0.0))


def test_single_undefined_velocities_and_dummies(tmp_path: Path) -> None:
    """One undefined velocity or dummy of 61 is more than 1 %, and costs no mass."""
    case = late(tmp_path / "case", youngest_s=0.0)
    whole = read_cfd(CfdSpray(file=case))
    form, folder = foam.form(), case / CLOUD
    velocity = vectors(read_foam(folder / "U"))
    size = scalars(read_foam(folder / "d"))
    velocity[7, 1] = np.nan
    form.write(folder / "U", "vectorField", form.numbers(velocity))
    found = read_cfd(CfdSpray(file=case, parcels_left_out=0.0))
    assert found.notes["liquid_mass_kg"] == whole.notes["liquid_mass_kg"]
    assert any(
        "/U: 1 of 400 parcels have no finite value, such as parcel 7 at" in remark
        for remark in found.remarks
    )
    velocity[:200] = np.nan
    form.write(folder / "U", "vectorField", form.numbers(velocity))
    refused(case, r"/U: 200 of 400 parcels have no finite value", axis=None, nozzle_m=None)
    read(case, nozzle_m=(0, 0, 0), axis="+y")
    velocity[:200] = velocity[200:]
    form.write(folder / "U", "vectorField", form.numbers(velocity))
    dummies = np.where(np.arange(400) < 30, 0.0, size)
    form.write(folder / "d", "scalarField", form.numbers(dummies))
    found = read(case, nozzle_m=(0, 0, 0), axis="+y")
    assert found.notes["parcels"] == 370
    assert any("Omitted 30 of 400 parcels" in remark for remark in found.remarks)
    form.write(folder / "d", "scalarField", form.numbers(np.where(np.arange(400) < 300, 0.0, size)))
    refused(case, r"300 of 400 parcels are impossible", nozzle_m=(0, 0, 0), axis="+y")


@pytest.mark.parametrize("head", [b"", b"List<scalar> ", b"/* no count */ "])
def test_lists_without_their_length(tmp_path: Path, head: bytes) -> None:
    """OpenFOAM reads a list in ascii without its length, too."""
    block, case = foam.sample()[0], foam.case(tmp_path)
    whole = notes_of(case)
    for name in ("d", "U"):
        file = case / CLOUD / name
        file.write_bytes(file.read_bytes().replace(b"\n17\n(", b"\n" + head + b"("))
    field = case / "0.001/T"
    text = field.read_bytes()
    count = f"nonuniform List<scalar>\n{block.cells}\n(".encode()
    assert count in text
    field.write_bytes(text.replace(count, b"nonuniform " + head + b"("))
    assert notes_of(case) == whole
    field.write_bytes(field.read_bytes().replace(b"(\n", b"(\n600\n", 1))
    refused(case, f"{block.cells + 1} values, but the mesh has {block.cells} cells")


KNOWN = (0.0, 1e-3, 2e-3, 5e-4, 3e-3)


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ("all", [0.0, 5e-4, 1e-3, 2e-3, 3e-3]),
        ("::2", [0.0, 1e-3, 3e-3]),
        ("-2:", [2e-3, 3e-3]),
        ("1:3", [5e-4, 1e-3]),
        ([2e-3, 5e-4, 5e-4], [5e-4, 2e-3]),
        (["latest", "nearest 0.0021"], [2e-3, 3e-3]),
    ],
)
def test_times(wanted: str | list[float | str], expected: list[float]) -> None:
    assert list(choose_times("case", KNOWN, wanted)) == expected


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ([7e-4], r"case: no time 0\.0007 s .*available: 0, 0\.0005, 0\.001"),
        ("9:", r"case: 9:: selects none of its 5 times"),
        ("every", r"allowed: `all`"),
        ("::0", r"allowed: `all`"),
        ("1:2:3:4", r"allowed: `all`"),
    ],
)
def test_times_that_are_refused(wanted: str | list[float | str], message: str) -> None:
    with pytest.raises(SprayError, match=message):
        choose_times("case", KNOWN, wanted)


@pytest.mark.parametrize(
    ("text", "time"),
    [("0.95ms", 0.95e-3), ("950 us", 950e-6), ("1e-3 s", 1e-3), ("-12.5", -12.5), ("0.3", 0.3)],
)
def test_a_time_with_its_unit(text: str, time: float) -> None:
    """Exactly the number that the case has, not one beside it."""
    assert time_of(text) == time
    assert CfdSpray(file=Path("case"), time_s=text).time_s == time


@pytest.mark.parametrize("text", ["soon", "1 min", "ms", "1,5ms", ""])
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(ValueError, match="number"):
        time_of(text)


def test_one_frame_from_the_time_that_tells_it_best(tmp_path: Path) -> None:
    """Parcels tell the nozzle; the last time has none."""
    case = write_times(tmp_path / "case", {"0.0001": 4e-5, "0.0002": 1e-4, "0.0003": -1.0})
    spec, remarks = with_one_frame(CfdSpray(file=case), (1e-4, 2e-4, 3e-4))
    assert spec.nozzle_m == pytest.approx(NOZZLE, abs=2e-4)
    assert spec.axis == (0.0, -1.0, 0.0)
    assert any("extrapolated to age zero" in each for each in remarks)
    nozzle = {
        tuple(read_cfd(spec.model_copy(update={"time_s": t})).notes[f"nozzle_{x}_m"] for x in "xyz")
        for t in (1e-4, 2e-4)
    }
    assert nozzle == {spec.nozzle_m}


def test_a_frame_that_is_given_stays(tmp_path: Path) -> None:
    case = write_times(tmp_path / "case", {"0.0001": 4e-5})
    given = CfdSpray(file=case, nozzle_m=(0, 0.01, 0), axis="-y")
    assert with_one_frame(given, (1e-4,)) == (given, ())


def test_a_frame_that_no_time_tells(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")  # without ages
    with pytest.raises(SprayError, match="nozzle and axis"):
        with_one_frame(CfdSpray(file=case), (1e-3,))


def test_a_time_without_fuel_is_told_from_one_that_lacks_something(tmp_path: Path) -> None:
    times = {"0": 0.0, "0.0001": 4e-5, "0.0002": -1.0, "0.0003": 0.0}
    case = write_times(tmp_path / "case", times)

    with pytest.raises(NotAtThisTime, match=r"no parcels at this time, but at others: 0\.0001"):
        read(case, time_s=0.0, nozzle_m=NOZZLE)
    with pytest.raises(NotAtThisTime, match="no cell field 'C7H16'"):
        read(case, time_s=0.0, nozzle_m=NOZZLE, cloud="none")
    with pytest.raises(EmptyCloud, match="has no parcel"):
        read(case, time_s=2e-4, nozzle_m=NOZZLE)
    read(case, time_s=2e-4, nozzle_m=NOZZLE, cloud="none")
    zero = write_times(tmp_path / "zero", {"0.0001": -1.0})
    field = zero / "0.0001" / "C7H16"
    field.write_text(field.read_text().split("internalField")[0] + "internalField uniform 0;\n")
    with pytest.raises(NoFuel, match="no fuel: no liquid"):
        read(zero, cloud="none", nozzle_m=NOZZLE, axis="-y")


def test_penetrations_are_of_the_mass(tmp_path: Path) -> None:
    case = write_times(tmp_path / "case", {"0.0001": 1e-4})
    spray = read(case, nozzle_m=NOZZLE, axis="-y")
    assert spray.parcels is not None
    depth, mass = -spray.parcels.position_m[:, 2], spray.parcels.masses_kg
    for percent in (90, 95, 99):
        reach = spray.notes[f"liquid_penetration_{percent}_m"]
        above = float(mass[depth <= reach].sum() / mass.sum())
        before = float(mass[depth < reach].sum() / mass.sum())
        assert before < percent / 100 <= above
    assert np.isfinite(spray.notes["ambient_temperature_K"])
