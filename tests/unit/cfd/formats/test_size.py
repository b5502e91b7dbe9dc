"""Large cases: progress, Ctrl-C, and a refusal before anything is read."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path
from typing import Any

import pytest

from cldit.cfd import size
from cldit.cfd.importing import imported
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.composites import write_format
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import FRAME

KINDS = ["openfoam", "vtk", "tables", "ensight", "ensight-ascii", "converge"]
KINDS += ["vtkhdf", "cgns", "fluent"]


def written(kind: str, folder: Path) -> CfdSpray:
    """The sample in one format."""
    return CfdSpray(file=write_format(kind, folder, foam.sample()), **FRAME)


@pytest.mark.parametrize("kind", KINDS)
def test_progress_is_told(kind: str, tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    spec = written(kind, tmp_path / "case")
    out = tmp_path / "spray.npz"
    imported(spec, out, watch=lambda *each: told.append(each))
    assert all(0 <= done <= total for _, done, total in told)
    phases = [what for what, _, _ in told]
    assert "measuring cells" in phases
    assert phases[-1] == "writing spray.npz"
    assert phases[0].startswith(("reading", "measuring cells"))


@pytest.mark.parametrize("phase", ["reading gas.vtu", "measuring cells", "writing spray.npz"])
def test_control_c_leaves_nothing(phase: str, tmp_path: Path) -> None:
    """The signal itself, as the terminal sends it; vtk, too, stops."""
    spec = written("vtk", tmp_path / "case")
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


@pytest.mark.parametrize("kind", KINDS)
def test_what_does_not_fit_is_refused_before_it_is_read(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = written(kind, tmp_path / "case")
    monkeypatch.setattr(size, "free_bytes", lambda: 0.1e9)
    told: list[Any] = []
    with pytest.raises(SprayError) as caught:
        imported(spec, None, watch=lambda *each: told.append(each))
    text = str(caught.value)
    assert text.startswith(str(tmp_path / "case"))
    assert re.search("24 cells.* need some 0.2 GB of memory; 0.1 GB are free", text) or kind in (
        "openfoam",  # counts faces, or bytes
        "tables",
        "ensight",
        "ensight-ascii",
    )
    assert "GB of memory; 0.1 GB are free" in text
    assert "export only the region" in text
    assert told == []
