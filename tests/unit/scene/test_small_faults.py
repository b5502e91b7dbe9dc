"""Values that no user means: each is an error of the scene, in a message of bounded size."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from cldit.acquisition.journal import parse_entry
from cldit.errors import SceneError
from cldit.scene import load_scene
from cldit.scene.curves import check_curve

HEAD = "name: a\nspray: {model: cone}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: 0x" + "f" * 10_000 + "\n", "name: a number of more than 4300 digits is not text"),
        ("base: " + "a" * 5_000 + "\n", "aaa...: no such scene"),
        (
            HEAD + f"windows: [{{reflection: [[3, 0.1], [4, {10**400}]]}}]\n",
            "expected pairs of",
        ),
        (
            HEAD + "optics: {filter_um: [[3.3, true], [3.5, 1]]}\n",
            "curve: expected pairs",
        ),
        (HEAD + "".join(f"k{i}: 1\n" for i in range(3_000)), "and 2950 errors more"),
        (HEAD + "? " + "k" * 1_000_000 + "\n: 1\n", "kkk...: unknown key"),
    ],
)
def test_a_scene_is_refused_briefly(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")
    start_s = time.process_time()
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 20_000
    assert time.process_time() - start_s < 10.0  # 3,000 keys took 14 s


def test_curves_take_numbers_from_iterators() -> None:
    assert check_curve(zip((3.3, 3.5), (0.5, 1.0), strict=True), source="x")[0] == (3.3, 0.5)


@pytest.mark.parametrize("time", ["2026-01-01T10:00:00", "9999-01-01T10:00:00+00:00"])
def test_times_of_a_journal_have_a_zone_and_a_century(time: str) -> None:
    line = f'{{"seq": 0, "event": "stopped", "time": "{time}"}}\n'.encode()
    assert "without a zone or of another century" in parse_entry(line, 0)[0]
