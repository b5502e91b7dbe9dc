"""Interfaces of scripts and shells: `--json`, units, exit status, completion, width, colour."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
import yaml
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from cldit import __version__
from cldit.acquisition.progress import Progress
from cldit.acquisition.storage import JOURNAL
from cldit.cli import main
from cldit.cli.acquire import RecordingBar
from cldit.cli.as_json import Outcome, json_option, plain
from cldit.cli.console import OUT, plain_errors
from cldit.cli.options import KELVIN, Quantity
from cldit.cli.program import Exit, LazyGroup
from cldit.errors import SceneError
from cldit.spray.result import Parcels, Spray
from cldit.spray.spray_file import write_spray
from tests.command_line import command
from tests.journals import read_journal

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


def cldit(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "cldit", *map(str, words)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def found(*words: object) -> Any:
    """The JSON that is all of the output; what people read is beside it."""
    done = command(*words, "--json")
    assert done.stderr
    return json.loads(done.stdout)


def test_json_of_scenes_and_devices() -> None:
    assert {"gdi", "empty"} <= {scene["name"] for scene in found("scenes")}
    scene = found("scenes", "--show", "gdi")
    assert scene["name"] == "gdi" and "walls" in scene
    devices = found("devices")
    assert sum(device["used"] for device in devices["devices"]) == 1
    assert devices["drivers"]["dg645"]["kind"] == "trigger"


@pytest.mark.usefixtures("without_pages")
def test_json_of_an_evaluation(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(WRITTEN / "acquisition", tmp_path / "shots"))
    (one,) = found("evaluate", folder)["delays"]
    assert one["folder"] == str(folder / "maps") and one["problem"] == ""
    stored = json.loads((folder / "maps" / "evaluation.json").read_text())
    del stored["sha256"]  # digests of the files as they were written
    assert one["evaluation"] == stored


def test_json_of_an_import(tmp_path: Path) -> None:
    """Figures in SI, as the spray has them."""
    one = np.ones(2)
    places_m = np.array([[0.0, 0.0, -1e-3], [0.0, 0.0, -2e-3]])
    parcels = Parcels(places_m, 1e-5 * one, 1e6 * one, 350 * one, 700 * one)
    write_spray(tmp_path / "own.npz", Spray(parcels, notes={"liquid_mass_kg": parcels.mass_kg}))
    data = found("import", tmp_path / "own.npz")
    assert data["case"] == str(tmp_path / "own.npz") and data["out"] is None
    assert data["figures"]["liquid_mass_kg"] == pytest.approx(parcels.mass_kg)


def test_diff_is_compare_with_a_warning() -> None:
    old, new = (command(name, WRITTEN, WRITTEN, "--json") for name in ("diff", "compare"))
    assert json.loads(old.stdout) == json.loads(new.stdout)
    assert "deprecated" in old.stderr and "deprecated" not in new.stderr


@pytest.mark.parametrize("name", ["run", "compare", "scenes", "devices", "plan", "import", "fit",
                                  "evaluate"])  # fmt: skip
def test_commands_for_scripts_have_it(name: str) -> None:
    command = main.get_command(click.Context(main), name)
    assert command is not None and "--json" in {o for p in command.params for o in p.opts}


@pytest.mark.parametrize("name", ["run", "evaluate", "show", "compare", "plan", "study", "bench"])
def test_commands_that_draw_take_one_format(name: str) -> None:
    command = main.get_command(click.Context(main), name)
    assert command is not None
    (option,) = (one for one in command.params if "--format" in one.opts)
    assert option.name == "suffix" and isinstance(option.type, click.Choice)
    given = option.type_cast_value(click.Context(command), "svg")
    assert option.callback is not None
    assert option.callback(click.Context(command), option, given) == ".svg"


@pytest.mark.usefixtures("without_pages")
def test_an_evaluation_writes_its_figure_in_a_format(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(WRITTEN / "acquisition", tmp_path / "shots"))
    assert str(folder / "maps.pdf") in command("evaluate", folder, "--format", "pdf").output
    assert (folder / "maps.pdf").read_bytes().startswith(b"%PDF")


def test_plain_values() -> None:
    value = {"a": (Path("x"), np.float32(1.5), float("nan")), 1: np.arange(2), "e": Exit.DIFFERS}
    assert plain(value) == {"a": ["x", 1.5, None], "1": [0, 1], "e": 3}


def ending(what: Callable[[], Outcome]) -> Any:
    @click.command()
    @json_option
    @plain_errors
    def tried() -> Outcome:
        OUT.print("for people")
        return what()

    return CliRunner().invoke(tried, ["--json"])


def test_exit_status_of_results_errors_and_stops() -> None:
    assert (done := ending(lambda: Outcome({"a": 1}, Exit.DIFFERS))).exit_code == 3
    assert json.loads(done.stdout) == {"a": 1} and "for people" in done.stderr

    def fails() -> Outcome:
        raise SceneError("x: is no scene")

    assert (done := ending(fails)).exit_code == 1
    assert done.stdout == "" and "error: x: is no scene" in done.stderr

    def stops() -> Outcome:
        raise KeyboardInterrupt

    assert ending(stops).exit_code == 130


def test_exit_status_of_the_program() -> None:
    command("run", "nothing-like-it", status=Exit.FAILED)
    command("run", "--no-such-option", status=Exit.USAGE)
    command("compare", WRITTEN, WRITTEN, status=Exit.DONE)
    shown = command("--help").stdout
    for code in Exit:
        assert f"  {code.value:<4d}{code.text}\n" in shown


@pytest.mark.parametrize("columns", [60, 80])
@pytest.mark.parametrize("words", ["devices", "scenes", "--help", "compare run-0.1.0 run-0.1.0"])
def test_narrow_terminals_cut_nothing(
    words: str, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All letters are there, whatever the width.

    Run folders are named relative to the current folder: a line of text is never broken, and a
    path in it may be of any length.
    """
    monkeypatch.chdir(WRITTEN.parent)

    def printed(width: int) -> str:
        monkeypatch.setattr(OUT, "_width", width)
        monkeypatch.setenv("COLUMNS", str(width))
        return CliRunner().invoke(main, words.split(), catch_exceptions=False).stdout

    narrow, wide = printed(columns), printed(400)
    assert "…" not in narrow and "..." not in narrow.replace("ARGS]...", "")
    tables = [line for line in narrow.splitlines() if not line.startswith(("*", "  "))]
    assert all(len(line.rstrip()) <= columns or " " not in line[columns:] for line in tables)

    def letters(text: str) -> list[str]:
        return sorted(re.sub(r"\s", "", text))

    assert letters(narrow) == letters(wide)


@pytest.mark.usefixtures("without_pages")
def test_no_color() -> None:
    colour = re.compile(r"\x1b\[[0-9;]*3[0-7]")
    words = ["scenes", "--show", "nothing-like-it"]
    assert colour.search(cldit(*words, FORCE_COLOR="1", TERM="xterm").stderr)
    assert not colour.search(cldit(*words, FORCE_COLOR="1", TERM="xterm", NO_COLOR="1").stderr)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("cldit sc", {"scenes"}),
        ("cldit run gdi-", {"gdi-cold", "gdi-cone", "gdi-extinction"}),
        ("cldit compare --al", {"--align"}),
        ("cldit bench --budget-scene even", {"even-grid"}),
    ],
)
def test_completion(line: str, expected: set[str]) -> None:
    *words, last = line.split()[1:]
    shell = ShellComplete(main, {}, "cldit", "_CLDIT_COMPLETE")
    assert {one.value for one in shell.get_completions(words, last)} == expected


def loaded_by(words: list[str], **environment: str) -> set[str]:
    code = (
        "import sys; from cldit.cli import main\n"
        "try: main(prog_name='cldit')\n"
        "finally: print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return set(done.stderr.split())


@pytest.mark.parametrize(
    "environment",
    [{}, {"_CLDIT_COMPLETE": "bash_complete", "COMP_WORDS": "cldit s", "COMP_CWORD": "1"}],
    ids=["help", "completion"],
)
def test_help_and_completion_load_no_command(environment: dict[str, str]) -> None:
    modules = loaded_by([] if environment else ["--help"], **environment)
    ours = {name for name in modules if name.partition(".")[0] == "cldit"}
    # `cldit` gives results the function that loads their figures: presented, extras.
    assert ours == {"cldit", "cldit.cli", "cldit.cli.program", "cldit.errors", "cldit.io",
                    "cldit.io.extras", "cldit.io.presented", "cldit.io.terminal"}  # fmt: skip
    assert not modules & {"numpy", "rich", "yaml", "pydantic", "matplotlib", "pyopencl"}


@pytest.mark.parametrize("text", ["0.1", "0.1K", "0.1 K", " 1e-1K"])
def test_unit_may_be_written(text: str) -> None:
    assert KELVIN.convert(text, None, None) == 0.1


def test_default_passes() -> None:
    assert Quantity("s").convert(0.5, None, None) == 0.5


@pytest.mark.parametrize("text", ["", "K", "0.1mK", "0.1s", "warm", "1K2"])
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter, match=r"not a number of K; allowed: e\.g\. 0\.1K"):
        KELVIN.convert(text, None, None)


def test_ctrl_c(tiny_rig: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first shot; the rig is made safe."""
    rig, plan, out = tmp_path / "rig.yaml", tmp_path / "plan.yaml", tmp_path / "shots"
    rig.write_text(yaml.safe_dump(tiny_rig), encoding="utf-8")
    plan.write_text("backgrounds_K: [440.0]\nshots: 3\n", encoding="utf-8")

    def press(bar: RecordingBar, progress: Progress) -> None:
        if progress.done == 1:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(RecordingBar, "watch", press)
    done = command("acquire", rig, plan, "--out", out, status=Exit.STOPPED)
    assert "not complete; run the same command again" in done.stderr
    assert [entry["event"] for entry in read_journal(out / JOURNAL)][-1] == "made safe"


SLOW = {"matplotlib", "scipy", "pyopencl", "CoolProp", "vtk"}


@pytest.mark.parametrize("words", [["bench", "--help"], ["scenes"], ["acquire", "--help"]])
def test_only_what_a_command_uses(words: list[str]) -> None:
    assert not {name.partition(".")[0] for name in loaded_by(words)} & SLOW


def test_modules_of_a_run_load_no_package_that_few_runs_use() -> None:
    """SciPy's packages are loaded by the calls of their functions."""
    code = (
        "import sys, cldit.cli.run; "
        "print(*(name for name in sys.modules if name.startswith(('scipy.', 'matplotlib'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[1] for name in done.stdout.split() if "." in name}
    assert not loaded & {"special", "ndimage", "linalg", "optimize", "interpolate", "spatial"}
    assert "matplotlib" not in done.stdout


def test_help_says_what_click_would() -> None:
    """Texts that are read from the sources are those of the commands, here of those soon loaded.

    On wide lines, where click cuts nothing.
    """
    quick = {name: main.commands_at[name] for name in ("scenes", "devices", "export", "study")}
    group = LazyGroup(commands_at=quick)
    context = click.Context(group, info_name="cldit", terminal_width=400, max_content_width=400)
    ours, theirs = (context.make_formatter() for _ in range(2))
    group.format_commands(context, ours)
    click.Group.format_commands(group, context, theirs)
    assert ours.getvalue() == theirs.getvalue() != ""


def test_python_m_cldit_is_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "cldit", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == CliRunner().invoke(main, ["--version"], prog_name="cldit").stdout
    assert done.stdout == f"cldit, version {__version__}\n"
