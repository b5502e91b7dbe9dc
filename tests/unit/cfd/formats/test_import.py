"""cldit import: its file, progress, Ctrl-C, large cases, and the page on it."""

from __future__ import annotations

import hashlib
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from cldit.cfd.importing import imported
from cldit.cfd.mapping.file import read_column_map
from cldit.cfd.to_spray import read_cfd
from cldit.cli import main
from cldit.errors import SprayError
from cldit.scene.load import load_scene
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.formats.conftest import write_ensight
from tests.unit.cfd.reading import FRAME, read, same


def test_command(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")
    out = tmp_path / "spray.npz"

    def called(*arguments: str, code: int = 0) -> str:
        result = CliRunner().invoke(main, ["import", *arguments])
        assert result.exit_code == code, result.output
        return result.output

    text = called(str(case), "--list")
    assert "format: openfoam" in text
    assert "times in s: 0.001" in text
    assert "cell fields: C7H16, T, p, rho" in text
    assert "cloud sprayCloud: T, U, d, nParticle, positions, rho" in text
    place = ["--nozzle", "0.0005", "0.009", "0.0001", "--axis", "0,-1,0"]
    text = called(str(case), *place, "--out", str(out))
    told = read(case)
    assert re.search(rf"liquid mass +{told.notes['liquid_mass_kg'] * 1e6:.5g} mg", text)
    assert re.search(r"Sauter mean diameter +\d", text)
    assert re.search(r"liquid penetration .* mm", text)
    stored = read_cfd(CfdSpray(file=out))
    assert same(stored, told) and stored.remarks == told.remarks
    assert "format: cldit" in called(str(out), "--list")
    assert "is not a direction" in called(str(case), "--axis", "0,-1,up", code=2)
    assert not list(tmp_path.glob("*.part"))
    wrong = called(str(case), "--fuel-field", "fuel", "--out", str(tmp_path / "no.npz"), code=1)
    assert "no cell field 'fuel'" in wrong
    assert not (tmp_path / "no.npz").exists()
    assert "ends in .npz" in called(str(case), *place, "--out", str(tmp_path / "a.h5"), code=1)


PLACE = ("--axis", "-y", "--nozzle", "0", "0.009", "0")


def test_own_file_that_is_damaged(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")
    out = tmp_path / "spray.npz"
    result = CliRunner().invoke(main, ["import", str(case), *PLACE, "--out", str(out)])
    assert result.exit_code == 0, result.output
    whole = out.read_bytes()
    for left in (0.0, 0.3, 0.9, 0.99):
        out.write_bytes(whole[: int(left * len(whole))])
        with pytest.raises(SprayError, match=re.escape(str(out))):
            read_cfd(CfdSpray(file=out))
    out.write_bytes(whole)
    expected, noticed = read_cfd(CfdSpray(file=out)), 0
    places = np.linspace(0, len(whole) - 1, 60).astype(int).tolist()
    for place in places:  # some hit only dates in the archive, which do not matter
        flipped = bytearray(whole)
        flipped[place] ^= 0xFF
        out.write_bytes(bytes(flipped))
        try:
            assert same(read_cfd(CfdSpray(file=out)), expected)
        except SprayError as error:
            assert str(out) in str(error)
            noticed += 1
    assert noticed > len(places) / 2
    out.write_bytes(whole)
    with pytest.raises(SprayError, match=r"spray\.axis was fixed when the case was imported"):
        read_cfd(CfdSpray(file=out, axis="-y"))
    with pytest.raises(SprayError, match=r"no time 0\.5 s"):
        read_cfd(CfdSpray(file=out, time_s=0.5))
    with np.load(out) as archive:
        arrays = dict(archive)
    for name, change, message in (
        ("parcels/diameter_m", lambda v: -v, r"spray\.npz: parcels\.diameter_m: -"),
        ("vapour/temperature_K", lambda v: v * np.nan, r"vapour\.temperature_K: .* not finite"),
        ("parcels/droplets", None, r"spray\.npz: parcels/droplets is missing"),
        ("about", lambda v: np.array(str(v).replace('"layout": 2', '"layout": 9')), "layout 9"),
    ):
        kept = {key: value for key, value in arrays.items() if key != name}
        if change is not None:
            kept[name] = change(arrays[name])
        np.savez_compressed(out, **kept)
        with pytest.raises(SprayError, match=message):
            read_cfd(CfdSpray(file=out))


def test_scene_finds_its_files(tmp_path: Path) -> None:
    path = write_ensight(tmp_path / "data", foam.sample(), binary=True)
    (tmp_path / "names.yaml").write_text("parcels: {density: 700}")
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "name: s\nspray: {model: cfd, format: ensight, file: data/case.case,\n"
        "  mapping: names.yaml, axis: -y, nozzle_m: [0, 0.009, 0]}\n"
    )
    spray = load_scene(scene).spray
    assert isinstance(spray, CfdSpray)
    assert spray.file == path
    assert spray.mapping == tmp_path / "names.yaml"
    assert read_cfd(spray).notes["parcels"] == 17


PAGE = Path(__file__).parents[4] / "docs" / "importing.md"


def test_page_of_the_docs(tmp_path: Path) -> None:
    """Its examples are allowed, and the options that it names are there."""
    page = PAGE.read_text(encoding="utf-8")
    scene, *maps = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    spray = CfdSpray.model_validate(yaml.safe_load(scene)["spray"])
    assert spray.axis == (0.0, -1.0, 0.0)
    assert len(maps) == 2
    for text in maps:
        (tmp_path / "map.yaml").write_text(text)
        assert read_column_map(tmp_path / "map.yaml").parcels is not None
    known = CliRunner().invoke(main, ["import", "--help"]).output
    known += CliRunner().invoke(main, ["run", "--help"]).output
    known += CliRunner().invoke(main, ["bench", "--help"]).output
    known += CliRunner().invoke(main, ["export", "--help"]).output
    named = set(re.findall(r"--[a-z][a-z-]+", page)) - {"--help"}
    assert len(named) > 8
    assert not {option for option in named if option not in known}


@pytest.mark.parametrize("phase", ["reading gas.vtu", "measuring cells", "writing spray.npz"])
def test_control_c_leaves_nothing(phase: str, tmp_path: Path) -> None:
    """The signal itself, as the terminal sends it; vtk, too, stops."""
    spec = CfdSpray(file=write_format("vtk", tmp_path / "case", foam.sample()), **FRAME)
    folder = tmp_path / "out"
    folder.mkdir()
    before = signal.getsignal(signal.SIGINT)  # a shell's background jobs ignore it
    handler = signal.default_int_handler
    signal.signal(signal.SIGINT, handler)

    def press(what: str, *_: int) -> None:
        if what == phase:
            os.kill(os.getpid(), signal.SIGINT)

    try:
        with pytest.raises(KeyboardInterrupt):
            imported(spec, folder / "spray.npz", watch=press)
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert list(folder.iterdir()) == []


def test_import_prints_and_keeps_them(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")
    (case / "0.001" / "unused").write_text("not read")
    out = tmp_path / "spray.npz"
    done = CliRunner().invoke(main, ["import", str(case), *PLACE, "--out", str(out), "-v"])
    assert done.exit_code == 0, done.output
    kept = read_cfd(CfdSpray(file=out)).files
    assert Path(kept[0].path) == out
    names = {Path(file.path).relative_to(case).as_posix() for file in kept[1:]}
    mesh = {f"constant/polyMesh/{n}" for n in ("points", "faces", "owner", "neighbour", "boundary")}
    drops = {"positions", "d", "nParticle", "T", "rho", "U"}
    fields = {f"0.001/{name}" for name in ("T", "p", "rho", "C7H16")}
    assert names == mesh | fields | {f"0.001/lagrangian/sprayCloud/{name}" for name in drops}
    for file in kept[1:]:
        assert file.sha256 == hashlib.sha256(Path(file.path).read_bytes()).hexdigest()
        assert f"read {file.path} ({file.bytes} bytes, " in done.output.replace("\n", "")
