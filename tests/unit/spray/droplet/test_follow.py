"""`cldit droplet`: what it prints, draws and refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cldit.cli import main
from cldit.errors import SprayError
from cldit.gpu.device import Device
from cldit.spray.droplet.follow import follow

PAPER: dict[str, Any] = {
    "fuel": "n-heptane",
    "diameter_m": 9e-6,
    "temperature_K": 370.0,
    "gas_temperature_K": 573.0,
    "pressure_Pa": 0.6e6,
}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tables")


def test_command_prints_columns(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    monkeypatch.setattr("cldit.cli.sprays.default_cache", lambda: cache)
    text = (
        "droplet --fuel n-heptane --diameter-um 9 --temperature 370 --gas-temperature 573 "
        "--pressure 0.6e6 --velocity 0 --model abramzon-sirignano --csv"
    )
    result = CliRunner().invoke(main, text.split())
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0] == "time_s,diameter_m,temperature_K,velocity_m_s,mass_kg"
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert rows[0, :4] == pytest.approx([0.0, 9e-6, 370.0, 0.0])
    assert rows[-1, 1] == rows[-1, 4] == 0.0
    assert rows[-1, 0] == pytest.approx(534e-6, rel=0.01)  # see tests/verify
    assert np.all(np.diff(rows[:, 0]) > 0) and np.all(np.diff(rows[:, 4]) < 0)


def test_command_draws(monkeypatch: pytest.MonkeyPatch, cache: Path, tmp_path: Path) -> None:
    monkeypatch.setattr("cldit.cli.sprays.default_cache", lambda: cache)
    out = tmp_path / "life.png"
    result = CliRunner().invoke(main, ["droplet", "--velocity", "50", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert out.read_bytes().startswith(b"\x89PNG")
    assert "vanished after" in result.output
    missing = tmp_path / "no" / "life.png"
    result = CliRunner().invoke(main, ["droplet", "--out", str(missing)])
    assert result.exit_code == 1
    assert isinstance(result.exception, SystemExit)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"diameter_m": -9e-6}, "diameter -9 um; allowed: "),
        ({"diameter_m": 9.0}, "diameter 9e.06 um.*check the unit"),
        ({"temperature_K": 545.0}, "supercritical"),
        ({"temperature_K": 100.0}, "frozen"),
        ({"temperature_K": float("nan")}, "must be finite"),
        ({"gas_temperature_K": 5000.0}, "gas temperature 5000 K; allowed: "),
        ({"pressure_Pa": 6.0}, "pressure 6 Pa; allowed: "),
        ({"velocity_m_s": float("nan")}, "velocity nan"),
        ({"vapour": 1.5}, "vapour mass fraction 1.5"),
        ({"model": "frolov"}, "allowed: abramzon-sirignano, spalding"),
        ({"duration_s": -1.0}, "duration -1 s"),
    ],
)
def test_bad_values_are_refused(
    change: dict[str, Any], says: str, device: Device, cache: Path
) -> None:
    with pytest.raises(SprayError, match=says):
        follow(**{**PAPER, **change}, device=device, cache=cache)


def test_a_droplet_that_stays_needs_a_duration(device: Device, cache: Path) -> None:
    """In its own vapour at its own saturation it can neither evaporate nor grow."""
    saturated = {**PAPER, "gas_temperature_K": 370.0, "vapour": 0.9}
    with pytest.raises(SprayError, match=r"does not vanish .* give a duration"):
        follow(**saturated, device=device, cache=cache)
    life = follow(**saturated, duration_s=1e-3, points=11, device=device, cache=cache)
    assert life.time_s[-1] == 1e-3 and not life.vanished
    assert life.mass_kg[-1] > life.mass_kg[0]  # 0.9 is above saturation: it condenses
