"""Every file that a spray was read from is recorded: printed, in cldit's own file, in the run."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from cldit.cfd.to_spray import read_cfd
from cldit.cli import main
from cldit.errors import SprayError
from cldit.io.origin import FileRead, files_read
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam

PLACE = ("--axis", "-y", "--nozzle", "0", "0.009", "0")


def test_record(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(b"abc")
    (record,) = files_read([file, tmp_path / "." / "a.txt"])
    assert record.bytes == 3
    assert record.sha256 == hashlib.sha256(b"abc").hexdigest()
    assert record.modified.endswith("+00:00")
    assert FileRead.from_dict(record.to_dict()) == record
    assert not record.change
    file.write_bytes(b"abd")  # of the same size, and of the same second
    assert record.change
    file.unlink()
    assert record.change
    file.write_bytes(b"abc")
    with pytest.raises(OSError, match="none"):
        files_read([tmp_path / "none"])


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


@pytest.mark.parametrize("new", [True, False])
def test_streams_of_converge(tmp_path: Path, new: bool) -> None:
    """A solid stream has no fuel, and is left out by name; two files of a time are an error."""
    h5py = pytest.importorskip("h5py")
    from tests.unit.cfd.formats.conftest import write_converge

    keys: dict[str, Any] = {"nozzle_m": (0.5e-3, 9e-3, 0.1e-3), "axis": "-y"}
    folder = write_converge(tmp_path / "h5", foam.sample(), new=new)
    expected = read_cfd(CfdSpray(file=folder, **keys))
    last = max(folder.iterdir())
    assert [Path(file.path) for file in expected.files] == [last]
    with h5py.File(last, "r+") as post:
        post.copy("STREAM_00", "STREAM_01")
        solid = post["STREAM_01"]
        del solid["PARCEL_DATA"], solid["CELL_CENTER_DATA/MASSFRAC_C7H16"]
        solid["CELL_CENTER_DATA/DENSITY"][...] = 7800.0
    spray = read_cfd(CfdSpray(file=folder, **keys))
    assert spray.notes == expected.notes
    assert any(
        "without C7H16 were omitted" in text and "STREAM_01" in text for text in spray.remarks
    )
    (folder / "copy.h5").write_bytes(last.read_bytes())
    with pytest.raises(SprayError, match=r"2 claim to be time 0\.001: .*copy\.h5"):
        read_cfd(CfdSpray(file=folder, **keys))
