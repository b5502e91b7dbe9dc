"""A run that states an error larger than was asked for says so, and what can be done."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cldit.gpu.device import Device
from cldit.run import open_run, simulate
from cldit.run.accuracy import StatedError
from cldit.scene import load_scene, parse_scene
from cldit.scene.transport import Transport


@pytest.mark.parametrize(
    ("halves", "audit", "asked", "said"),
    [
        (0.05, 0.24, {}, "audit by path tracing finds it, where directions and chains make some 0"),
        (0.05, 0.24, {"directions": 16}, "allowed is more transport.directions for that part"),
        (0.24, 0.0, {}, "directions and chains make it; allowed is a smaller transport.accuracy_K"),
        (0.24, 0.2, {"directions": 16}, "make it; allowed is more transport.directions"),
        (0.24, 0.0, {"method": "path"}, "allowed is a larger transport.max_samples"),
    ],
)
def test_more_than_asked(halves: float, audit: float, asked: dict[str, Any], said: str) -> None:
    (text,) = StatedError(halves, audit).remarks(Transport(accuracy_K=0.1, **asked))
    assert text.startswith("stated error 0.24 K RMS, more than transport.accuracy_K: 0.1 asks for:")
    assert said in text


@pytest.mark.parametrize(
    ("method", "audit", "halves"), [("source", 0.0, 0.13), ("source", 0.2, 0.1), ("path", 0.0, 0.1)]
)
def test_what_two_pictures_share(
    method: str, audit: float, halves: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Is allowed for where no audit sees it; samples of `path` share nothing."""
    monkeypatch.setattr("cldit.run.accuracy.temperature_error_K", lambda *_, **__: 0.1)
    data = load_scene("droplets-only").model_dump(mode="json")
    data["transport"]["method"] = method
    result: Any = SimpleNamespace(difference=True, audit_K=audit)
    maps: Any = None
    stated = StatedError.of(parse_scene(data), result, maps)
    assert stated is not None
    assert (stated.halves_K, stated.audit_K) == pytest.approx((halves, audit))


@pytest.mark.parametrize(
    ("halves", "told"), [(0.0, 0), (0.1, 0), (0.1049, 0), (0.1051, 1), (float("nan"), 0)]
)
def test_as_asked(halves: float, told: int) -> None:
    """As it is printed, with two digits; without a T_app there is no error to speak of."""
    assert len(StatedError(halves).remarks(Transport(accuracy_K=0.1))) == told


def test_runs_say_so(device: Device, tmp_path: Path) -> None:
    """As it goes, in run.json, and in the run that is opened again; not where 100 K will do."""
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"]["pixels"] = [8, 8]
    data["domain"]["leaf_edge_m"] = 4e-3
    for kelvin, told in ((1e-3, 1), (100.0, 0)):
        lines: list[str] = []
        data["transport"] |= {"accuracy_K": kelvin, "directions": 8, "gather": False}
        folder = tmp_path / str(kelvin)
        run = simulate(parse_scene(data), folder, device=device, progress=lines.append)
        kept = json.loads((folder / "run.json").read_text())["remarks"]
        for texts in (lines, kept, run.info.remarks, open_run(folder).info.remarks):
            assert sum("more than transport.accuracy_K" in text for text in texts) == told
