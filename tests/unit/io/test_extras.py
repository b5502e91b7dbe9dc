"""Install lines name packages that exist, of this installation's own metadata."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cldit.errors import StudyError
from cldit.io.extras import install_line, needed


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
