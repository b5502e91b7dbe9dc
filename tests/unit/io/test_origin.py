"""The record beside a result, and install lines of packages by their extras."""

from __future__ import annotations

import getpass
import hashlib
import json
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from cldit.errors import StudyError
from cldit.io import origin
from cldit.io.extras import install_line, needed
from cldit.io.origin import FileRead, Origin, files_read, versions


def test_it_reads_back_and_names_nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    home = tmp_path / "home of somebody"
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setattr("sys.argv", ["/opt/x/bin/cldit", "run", f"--out={home}/runs", f"{home}s"])
    made = Origin.now(scene={"rig": {"seed": 3}, "spray": {"seed": None}})
    assert made.command == ("cldit", "run", "--out=~/runs", f"{home}s")
    assert made.seeds == {"rig.seed": 3}
    text = json.dumps(made.to_dict())
    assert TypeAdapter(Origin).validate_json(text) == made
    assert platform.node() not in text and f"{home}/" not in text
    user = getpass.getuser()
    assert user not in {part for word in made.command for part in word.split("/")}


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (["/a/cldit/__main__.py", "scenes"], ("cldit", "scenes")),
        (["work.py"], ("work.py",)),
        ([""], ()),
    ],
)
def test_the_program_has_no_folder(
    words: list[str], command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", words)
    assert Origin.now().command == command


def test_packages_that_compute_have_versions() -> None:
    assert {"cldit", "numpy", "scipy", "CoolProp", "miepython", "python"} <= set(versions())


def test_commit_of_a_checkout_and_of_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "cldit" / "io"
    package.mkdir(parents=True)
    file = package / "origin.py"
    file.write_text("a = 1\n")
    monkeypatch.setattr(origin, "__file__", str(file))
    find = origin.commit.__wrapped__
    assert find() is None
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "a"]):
        subprocess.run([*git, *words], check=True)
    clean = find()
    assert clean is not None and len(clean) == 40
    file.write_text("a = 2\n")
    assert find() == f"{clean}+changes"
    monkeypatch.setenv("PATH", str(tmp_path))  # no git
    assert find() is None


@pytest.mark.parametrize(
    ("extra", "packages"),
    [("pocl", ["pyopencl[pocl]"]), ("cfd", ["h5py>=", "vtk>="]), ("film", ["imageio-ffmpeg>="]),
     ("studies", ["xarray>=", "zarr>=", "distributed>="])],
)  # fmt: skip
def test_packages_of_an_extra_are_named(
    extra: str, packages: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # away from the Python, whose path is then whole
    line = install_line(extra)
    assert line.lstrip('"').startswith(sys.executable) and " -m pip install " in line
    assert "cldit[" not in line and all(f'"{package}' in line for package in packages)


def test_an_unknown_extra_is_refused() -> None:
    with pytest.raises(LookupError, match="no extra"):
        install_line("none such")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    folder = Path(sys.executable).parent
    monkeypatch.chdir(folder)
    with pytest.raises(StudyError, match=r'^--to nexus: needs h5py; .* "h5py>=.*", or not$') as got:
        needed("h5py", extra="export", needed_by="--to nexus:", error=StudyError, hint=", or not")
    assert f"with: {Path(sys.executable).name} -m pip install" in str(got.value)
    assert needed("json", extra="export", needed_by="x") is sys.modules["json"]


def test_record_of_a_file_that_was_read(tmp_path: Path) -> None:
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
