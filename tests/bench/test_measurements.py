"""`python -m tests.bench`: every measurement is described, and pages name only these."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.__main__ import MEASUREMENTS, described
from tests.bench.mutations import MUTATIONS, wrong_rows

ROOT = Path(__file__).parents[2]


def test_list_has_every_measurement() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.bench"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(MEASUREMENTS)
    assert all(len(described(name)) > 20 for name in MEASUREMENTS)


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_every_measurement_has_a_command(name: str) -> None:
    source = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    assert re.search(r"^def main\(", source, re.MULTILINE)


def test_mutations_follow_the_code() -> None:
    assert wrong_rows(ROOT, range(len(MUTATIONS))) == []


def test_named_measurements_exist() -> None:
    paths = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "cldit").rglob("*.py")]
    named = {
        found[1]
        for path in paths
        for found in re.finditer(
            r"python -m\s+tests\.bench[ .](\w+)", path.read_text(encoding="utf-8")
        )
    }
    assert len(named) > 10
    assert named <= set(MEASUREMENTS)


def test_unknown_measurement_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.bench", "nothing"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode != 0
    assert "no measurement nothing; allowed: ablation" in done.stderr
