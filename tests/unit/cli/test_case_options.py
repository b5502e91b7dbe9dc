"""`cldit run --cfd` and `cldit import` take the same options for the same keys of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from cldit.cli import run as run_module
from cldit.cli import sprays
from cldit.scene import Scene
from cldit.scene.spray import CfdSpray

ARGUMENTS = ["--sector", "90", "--symmetry", "x,y", "--region", "gas", "--axis", "0,-1,0"]
ARGUMENTS += ["--nozzle", "0", "0.1", "0", "--cloud", "none", "--time", "nearest 0.001"]
ARGUMENTS += ["--mapping", "m.yaml", "--cfd-format", "openfoam"]
ARGUMENTS += ["--accept", "tracks", "--accept", "cells"]


class Reached(Exception):
    """Raised in place of the work, with the keys that it was called for."""


def test_run_and_import_mean_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: dict[str, CfdSpray] = {}

    def imported(spec: CfdSpray, *_: Any, **__: Any) -> None:
        taken["import"] = spec
        raise Reached

    def ran(scene: Scene, *_: Any, **__: Any) -> None:
        assert isinstance(scene.spray, CfdSpray)
        assert scene.transport.accuracy_K == 1.0  # not what the spray of gdi allows
        taken["run"] = scene.spray
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sprays, "imported", imported)
    monkeypatch.setattr(run_module, "simulate", ran)
    for command, arguments in (
        (sprays.import_command, ["case"]),
        (run_module.run, ["gdi", "--cfd", "case", "--trace-only"]),
    ):
        result = CliRunner().invoke(command, [*arguments, *ARGUMENTS])
        assert isinstance(result.exception, Reached), result.output
    same = {"file", "mapping"}  # paths, which a run resolves
    assert taken["run"].model_dump(exclude=same) == taken["import"].model_dump(exclude=same)
    assert taken["run"].file == tmp_path / "case"
    assert taken["run"].mapping == tmp_path / "m.yaml"
    assert taken["import"].sector is not None
    assert taken["import"].sector.angle_deg == 90.0
    assert taken["import"].symmetry == ("x", "y")
    assert taken["import"].accept == ("tracks", "cells")
    assert taken["import"].axis == (0.0, -1.0, 0.0)


def test_axis_is_a_direction() -> None:
    result = CliRunner().invoke(sprays.import_command, ["case", "--axis", "0,down,0"])
    assert result.exit_code == click.BadParameter.exit_code
    assert "'0,down,0' is not a direction" in result.output
