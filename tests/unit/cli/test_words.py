"""Counts of what a user may have to learn: commands, their options, keys of scenes, docs to read.

The limits only fall. `python tests/unit/cli/test_words.py` prints the counts.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from cldit.cli import main, sprays
from cldit.cli import run as run_module
from cldit.scene import Scene
from cldit.scene.spray import CfdSpray
from tests.bench.scene_reference import reference

COMMANDS = 14
OPTIONS = 97
KEYS = 252
WORDS = 40000
_DOCS = Path(__file__).parents[3] / "docs"
_OLD = {
    "repeat": ("RUN", "cldit compare RUN --repeat"),
    "diff": ("A", "cldit compare"),
    "optics": ("SCENE", "cldit show SCENE --part optics"),
    "spray": ("SCENE", "cldit show SCENE --part spray"),
    "droplet": ("", "follow in Python"),
}


def listed() -> dict[str, list[str]]:
    """Options of each command that its help shows."""
    context = click.Context(main)
    found = {}
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        assert command is not None
        options = [one for one in command.params if isinstance(one, click.Option)]
        found[name] = [one.opts[-1] for one in options if not one.hidden]
    return found


def keys() -> int:
    """Entries of the reference of all keys: of scenes, rigs, plans and measurements."""
    return f"\n{reference()}".count("\n- `")


def words_of_docs() -> int:
    """Words of README and docs as `wc -w` counts them, without blocks of code."""
    pages = [_DOCS.parent / "README.md", *_DOCS.rglob("*.md")]
    texts = (page.read_text(encoding="utf-8") for page in pages)
    return sum(len(re.sub(r"(?ms)^```.*?^```$", "", text).split()) for text in texts)


def test_no_more_words() -> None:
    commands = listed()
    assert len(commands) <= COMMANDS
    assert sum(map(len, commands.values())) <= OPTIONS
    assert keys() <= KEYS
    assert words_of_docs() <= WORDS


@pytest.mark.parametrize("name", sorted(_OLD))
def test_an_old_name_says_the_new_one(name: str) -> None:
    command = main.get_command(click.Context(main), name)
    assert command is not None and _OLD[name][1] in str(command.deprecated)
    assert name not in CliRunner().invoke(main, ["--help"]).output.split()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["run", "no-such-scene", "--phase", "mie"], "use --set transport.phase=.."),
        (["run", "no-such-scene", "--method", "path"], "use --set transport.method=.."),
        (["show", "no-such-folder", "--open"], "use cldit view"),
        (
            ["export", "no-such-folder", "--device", "0:0", "--to", "vtu"],
            "use device= of ",
        ),
        (["study", "no-such-study", "--cache", "x"], "use XDG_CACHE_HOME"),
    ],
)
def test_an_old_option_says_what_replaces_it(words: list[str], says: str) -> None:
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 1 and f"{words[2]} is deprecated; {says}" in done.stderr
    assert words[2] not in CliRunner().invoke(main, [words[0], "--help"]).output.split()


@pytest.mark.parametrize(
    "words",
    [
        ["compare", "a"],
        ["compare", "a", "b", "--repeat"],
        ["compare", "a", "b", "--device", "0:0"],
        ["show", "a", "--out", "b"],
    ],
)
def test_options_of_another_use_are_refused(words: list[str]) -> None:
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2 and "allowed" in done.stderr


if __name__ == "__main__":
    commands = listed()
    sys.stdout.write(f"{len(commands)} commands, {sum(map(len, commands.values()))} options ")
    sys.stdout.write(f"({len(set().union(*commands.values()))} names), {keys()} keys, ")
    sys.stdout.write(f"{words_of_docs()} words of docs\n")
    for name, options in commands.items():
        sys.stdout.write(f"{name} {len(options)}: {' '.join(options)}\n")


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
        assert scene.optics.preset == "spectral"
        taken["run"] = scene.spray
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sprays, "imported", imported)
    monkeypatch.setattr(run_module, "simulate", ran)
    for command, arguments in (
        (sprays.import_command, ["case"]),
        (run_module.run, ["gdi", "--cfd", "case", "--trace-only", "--preset", "spectral"]),
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
