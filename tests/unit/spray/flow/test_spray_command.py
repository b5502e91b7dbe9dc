"""`cldit show --part spray`: a computed and an analytic spray, into a folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from cldit.cli import main


@pytest.fixture(autouse=True)
def _cache(tables: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tables))


@pytest.mark.parametrize(
    ("spray", "history"),
    [
        ("{model: lagrangian, time_s: 5.0e-5, box: {spacing_m: 2.0e-3}}", True),
        ("{model: cone, time_s: 3.0e-4, spacing_m: 1.5e-3}", False),
    ],
)
def test_pictures_and_files(tmp_path: Path, spray: str, history: bool) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(f"name: small\nspray: {spray}\n", encoding="utf-8")
    out = tmp_path / "out"
    result = CliRunner().invoke(main, ["show", str(scene), "--part", "spray", "--out", str(out)])
    assert result.exit_code == 0, result.output
    names = {"views.png", "parcels.vtp", "gas.vtu"} | (
        {"history.png", "history.csv"} if history else set()
    )
    assert {path.name for path in out.iterdir()} == names
    assert "vapour mass: " in result.output


@pytest.mark.parametrize(
    ("command", "name"), [(["show", "empty", "--part", "spray"], "out"), (["droplet"], "out.png")]
)
def test_a_place_that_cannot_be_written_is_a_message(
    tmp_path: Path, command: list[str], name: str
) -> None:
    (tmp_path / "file").touch()
    result = CliRunner().invoke(main, [*command, "--out", str(tmp_path / "file" / name)])
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)  # no traceback
    assert "Not a directory" in result.output
