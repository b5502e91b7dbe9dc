"""The page as one file that asks for nothing, its packed numbers, and what folders give it."""

from __future__ import annotations

import base64
import re
import shutil
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.errors import FileError, RunFolderError
from cldit.run.result import save_run
from cldit.scene.spray import ConeSpray
from cldit.show.view import page_html, save_page, view_items
from cldit.show.view.packing import MANTISSA_BITS, packed, rounded
from cldit.show.view.traced import traced_item
from tests.command_line import command
from tests.viewed import made_run, scene_for

OLD = Path(__file__).parents[3] / "data" / "run-0.1.0"


def test_the_page_asks_for_nothing() -> None:
    """No address but the names of SVG's elements; a policy of content refuses all others."""
    text = page_html([traced_item(made_run(scene_for()), source="made.yaml")])
    assert set(re.findall(r"https?://[^\s\"'<]+", text)) == {"http://www.w3.org/2000/svg"}
    assert "default-src 'none'" in text
    assert not re.search(r"\bsrc\s*=\s*[\"'](?!data:)", text)


def test_names_are_text_and_never_markup() -> None:
    evil = "</script><script>alert(1)</script>"
    scene = scene_for(name=evil, description=evil)
    text = page_html([traced_item(made_run(scene), source=evil)])
    assert evil not in text and "alert(1)" in text
    assert text.count("<script") == text.count("</script>")


def test_only_pixels_that_the_spray_changes_are_packed() -> None:
    """The blob ends at 45 mm: a disc of 45 mm radius on pixels of 4 mm, give or take its rim."""
    item = traced_item(made_run(scene_for()), source="")
    covered = item.arrays["covered"].astype(bool)
    assert covered.sum() == pytest.approx(np.pi * 45.0**2 / 4.0**2, rel=0.03)
    for one in item.head["components"]:
        assert item.arrays[one["array"]].shape == (covered.sum(),)


def test_nodes_are_packed_as_few_directions() -> None:
    """Light of five nodes at four temperatures, and of walls and patches at one each."""
    scene = scene_for(optics={"preset": "spectral"})
    item = traced_item(made_run(scene, nodes=5), source="")
    sources = [one["source"] for one in item.head["components"]]
    assert sources.count("wall") == sources.count("flange") == 1
    assert 2 <= sources.count("background") < 5
    assert set(item.head["locked"]) == {"background", "wall"}


def test_a_series_is_sorted_by_the_time_of_its_sprays(tmp_path: Path) -> None:
    for name, time_s in (("a", 1.5e-3), ("b", 0.5e-3), ("c", 1.0e-3)):
        run = made_run(scene_for())
        scene = run.scene.model_copy(update={"spray": ConeSpray(time_s=time_s)})
        save_run(made_run(scene), tmp_path / name)
    items = view_items([tmp_path])
    assert [item.head["time_s"] for item in items] == [0.5e-3, 1.0e-3, 1.5e-3]
    text = page_html(items)  # all have one name, so the time tells them apart
    assert all(f'"name": "made, {time}"' in text for time in ("0.5 ms", "1 ms", "1.5 ms"))
    (tmp_path / "c" / "run.json").unlink()
    said = command("view", tmp_path, "--save", tmp_path / "page.html").output
    assert f"{tmp_path / 'c'}: is not finished; omitted" in said
    assert len(view_items([tmp_path])) == 2


def test_a_run_and_its_recording() -> None:
    run, measured = view_items([OLD, OLD / "acquisition"])
    assert (run.head["kind"], measured.head["kind"]) == ("run", "measurement")
    assert measured.arrays["reason"].shape == (measured.head["rows"], measured.head["columns"])
    assert measured.head["name"] == "run-0.1.0, acquired"


def test_what_cannot_be_viewed_says_so(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="contains nothing to view; allowed: the folder of"):
        view_items([tmp_path])
    copy = tmp_path / "acquisition"
    shutil.copytree(OLD / "acquisition", copy)
    shutil.rmtree(copy / "maps")
    with pytest.raises(RunFolderError, match="is not evaluated yet; run `cldit evaluate"):
        view_items([copy])


def test_the_command_writes_into_the_run_or_where_it_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    save_run(made_run(scene_for()), folder)
    assert command("view", folder, "--no-open").output.strip() == str(folder / "view.html")
    assert "MB)" in command("view", folder, "--save", tmp_path / "mail.html").output
    assert (tmp_path / "mail.html").read_bytes() == (folder / "view.html").read_bytes()


def test_a_folder_that_cannot_be_written_leaves_the_page_in_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    save_run(made_run(scene_for()), folder)

    def refused(path: Path, items: object) -> None:
        if path.parent == folder:
            raise FileError(f"{path}: cannot be written")
        save_page(path, items)  # type: ignore[arg-type]

    monkeypatch.setattr("cldit.api.viewing.save_page", refused)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    opened: list[str] = []

    def opens(address: str) -> bool:
        opened.append(address)
        return True

    monkeypatch.setattr("webbrowser.open", opens)
    done = command("view", folder)
    (page,) = (tmp_path / "cache").rglob("*.html")
    assert done.output.strip() == str(page)
    assert opened == [page.as_uri()]


def unpacked(head: Mapping[str, Any], text: str) -> NDArray[np.float32]:
    """As unpack.js does it for float32."""
    data = zlib.decompress(base64.b64decode(text))
    planes = np.frombuffer(data, np.uint8).reshape(4, head["count"])
    folded = np.ascontiguousarray(planes.T).view("<u4").reshape(-1)
    step = (folded >> 1) ^ (0 - (folded & 1)).astype(np.uint32)
    return np.cumsum(step, dtype=np.uint32).view(np.float32)


def test_a_rounded_number_errs_by_half_of_its_last_bit() -> None:
    """2^-(b + 1) of the number, for a mantissa of b bits beside the leading one."""
    rng = np.random.default_rng(3)
    values = (rng.standard_normal(20_000) * 10.0 ** rng.uniform(-30, 30, 20_000)).astype(np.float32)
    for bits in (MANTISSA_BITS, 10):
        off = np.abs(rounded(values, bits).astype(float) / values - 1.0)
        assert 0.9 * 2.0 ** -(bits + 1) < off.max() <= 2.0 ** -(bits + 1)
    assert np.array_equal(rounded(values, 23), values)


def test_rounding_keeps_what_is_no_usual_number() -> None:
    values = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -2.0], np.float32)
    assert np.array_equal(rounded(values, 10), values, equal_nan=True)


def test_numbers_come_back_bit_for_bit() -> None:
    rng = np.random.default_rng(4)
    values = rng.standard_normal((30, 40)).astype(np.float32)
    values[3, 4] = np.nan
    values[5, 6:9] = [0.0, -np.inf, 3e38]
    back = unpacked(*packed(values)).reshape(values.shape)
    assert np.array_equal(back.view(np.uint32), values.view(np.uint32))
