"""The page of a recording: what it shows, that it needs nothing, and that it cannot do harm."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cldit.acquisition import Plan, acquire, open_acquisition
from cldit.acquisition.journal import Journal
from cldit.acquisition.watch import Reading, Seen, Watch
from cldit.cli import live
from cldit.cli.live import PAGE, PageWriter, write_pages
from cldit.errors import DiskFull
from cldit.rig.load import open_rig
from cldit.show.report.live import LastShot, live_figure, live_page
from tests.command_line import command
from tests.patience import HANG_s, until


def page_of(folder: Path, *, over: bool = True) -> str:
    """The page that is written at once, of a recording that has ended or goes on."""
    ended = threading.Event()
    if over:
        ended.set()
        write_pages(folder, ended)
    else:
        thread = threading.Thread(target=write_pages, args=(folder, ended))
        (folder / PAGE).unlink(missing_ok=True)
        thread.start()
        until((folder / PAGE).exists)
        text = (folder / PAGE).read_text(encoding="utf-8")
        ended.set()
        thread.join(HANG_s)
        return text
    return (folder / PAGE).read_text(encoding="utf-8")


class Enough(Exception):
    """Ends a recording in its middle."""


def begun(rig: dict[str, Any], plan: Plan, folder: Path, *, shots: int) -> Path:
    """A recording that was broken off after some shots."""
    taken = []

    def progress(state: Any) -> None:
        taken.append(state.done)
        if state.done == shots:
            raise Enough

    with pytest.raises(Enough):
        acquire(open_rig(rig), plan, folder, progress=progress)
    return folder


def test_page_of_a_whole_recording(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """All that it is to show is there, as it was recorded; nothing outside is addressed."""
    folder = tmp_path / "a"
    acquire(open_rig(tiny_rig), tiny_plan, folder)
    text = page_of(folder)
    assert "<h1>finished</h1>" in text and "0 of 10 shots left" in text
    assert 'http-equiv="refresh"' not in text and "<script" not in text
    last = max(open_acquisition(folder).shots, key=lambda shot: shot.path.stat().st_mtime_ns)
    image = open_acquisition(folder).load(last)
    assert last.id in text and f"{last.background_setpoint_K:g} K, {last.kind}" in text
    for value in (f"lowest {image.min()}", f"highest {image.max()}", "% of the pixels are sat"):
        assert value in text
    assert "set point 480 K" in text and "within ±0.2 K" in text
    assert text.count("data:image/png;base64,") == 1
    without = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=]+", "", text)
    assert "//" not in without and not re.search(r"(src|href|url|import)\s*[=(]\s*[^\"]", without)
    assert re.findall(r"(?:src|href)=\"([^\"]*)\"", without) == [""]


def test_page_in_the_middle(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    """It loads itself while the recording goes on; one that was broken off says what to do."""
    folder = begun(tiny_rig, tiny_plan, tmp_path / "a", shots=3)
    going = page_of(folder, over=False)
    assert '<meta http-equiv="refresh" content="2">' in going and "7 of 10 shots left, " in going
    assert 'aria-valuenow="3"' in going and 'style="width:30.00%"' in going
    ended = page_of(folder)
    assert "<h1>broken off</h1>" in ended and 'http-equiv="refresh"' not in ended
    assert "Run the same command to continue it." in ended


def test_an_earlier_session_is_no_state(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """A resumed recording is being prepared until it says something itself."""
    folder = begun(tiny_rig, tiny_plan, tmp_path / "a", shots=3)
    size = (folder / "journal.jsonl").stat().st_size
    watch = Watch(folder, known_bytes=size)
    assert watch.look() and watch.seen().state == "preparing" and watch.seen().done == 3
    assert not watch.look()
    with Journal(folder / "journal.jsonl") as journal:
        journal.append("unsafe", time="2026-01-01T00:00:00+00:00", problems=["it may be <hot>"])
    assert watch.look() and watch.seen().alarms == ("it may be <hot>",)
    acquire(open_rig(tiny_rig), tiny_plan, folder)
    assert watch.look() and watch.seen().state == "finished" and watch.seen().done == 10
    readings = [reading.reading_K for reading in watch.seen().readings]
    assert readings and all(290.0 < each < 490.0 for each in readings)


def test_what_cannot_be_read_or_written_is_told_and_harms_nothing(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk, then room again, while the writer goes on; nothing half written stays."""
    folder = begun(tiny_rig, tiny_plan, tmp_path / "a", shots=3)
    full = threading.Event()
    full.set()
    refused = []

    def room(where: Path, needed: int) -> None:
        if full.is_set():
            refused.append(needed)
            raise DiskFull(f"{where}: no room for <all>")

    monkeypatch.setattr(live, "check_room", room)
    monkeypatch.setattr(live, "_PAUSE_s", 0.02)
    ended = threading.Event()
    thread = threading.Thread(target=write_pages, args=(folder, ended))
    thread.start()
    until(lambda: len(refused) > 1)
    assert not (folder / PAGE).exists()
    full.clear()
    until((folder / PAGE).exists)
    assert "no room for &lt;all&gt;" in (folder / PAGE).read_text(encoding="utf-8")
    ended.set()
    thread.join(HANG_s)
    assert not list(folder.glob("*.part"))
    # Room for seven shots to come is kept, whatever the page takes.
    assert min(refused) > 7 * (folder / "shots" / "b00_ref_00.tif").stat().st_size


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is POSIX")
def test_a_killed_writer_leaves_the_recording_alone(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """Killed before the second shot: every shot is there, and the view says what happened."""
    folder = tmp_path / "a"
    with PageWriter(folder) as page:
        process = page.process
        assert process is not None

        def progress(state: Any) -> None:
            if state.done == 1 and process.poll() is None:
                os.kill(process.pid, signal.SIGKILL)
                process.wait()

        record = acquire(open_rig(tiny_rig), tiny_plan, folder, progress=progress)
    assert record.complete and len(open_acquisition(folder).whole().shots) == 10
    assert process.returncode == -signal.SIGKILL and "ended early (-9)" in page.problem


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL is POSIX")
def test_the_writer_ends_with_a_killed_recording(
    tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path
) -> None:
    """The pipe ends with whoever holds it, and the last page says so."""
    folder = begun(tiny_rig, tiny_plan, tmp_path / "a", shots=3)
    code = (
        "import sys, time; from pathlib import Path; from cldit.cli.live import PageWriter\n"
        "with PageWriter(Path(sys.argv[1])) as page:\n"
        "    print(page.process.pid, flush=True); time.sleep(600)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert "live.html" in holder.stdout.readline()
        pid = int(holder.stdout.readline())
        until((folder / PAGE).exists)
        assert "preparing" in (folder / PAGE).read_text(encoding="utf-8")
        holder.kill()
    until(lambda: "broken off" in (folder / PAGE).read_text(encoding="utf-8"))
    until(lambda: not _runs(pid))


def _runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"  # nobody may be there to collect it


def test_damage_is_told(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    """A journal and a picture that are damaged: the page shows what is whole, and says so."""
    folder = begun(tiny_rig, tiny_plan, tmp_path / "a", shots=3)
    (folder / "shots" / "b00_inj_00.tif").write_bytes(b"no picture")
    with (folder / "journal.jsonl").open("ab") as stream:
        stream.write(b"no entry\n")
    text = page_of(folder)
    assert "7 of 10 shots left" in text and "Some of this page could not be read" in text
    assert "b00_inj_00.tif" in text and "is not JSON" in text and "No shot yet." in text


def test_a_folder_that_cannot_be_does_not_stop_anything(tmp_path: Path) -> None:
    with PageWriter(tmp_path / "never made") as page:
        pass
    assert page.problem == "" and not page.path.exists()


_META = {"shot": "b00_ref_00", "kind": "reference", "background_setpoint_K": 440.0,
         "saturation_counts": 16383, "time": "2026-01-01T00:00:00+00:00"}  # fmt: skip


def test_saturated_pixels_show_in_a_reduced_image(tiny_plan: Plan) -> None:
    """One of 1024 x 1280 is in the image, the histogram and the text."""
    image = np.full((1024, 1280), 1000, np.uint16)
    image[-1, 1] = 16383
    readings = tuple(Reading(60.0 * n, 470.0 + n, 480.0) for n in range(9))
    seen = Seen(state="recording", plan=tiny_plan, readings=readings)
    shot = LastShot(image, _META)
    drawn: Any = live_figure(seen, shot)
    shown, counts, whole, close = drawn.axes[:4]
    marked = np.ma.count(shown.images[1].get_array(), axis=1)
    assert marked[-1] == 1 and marked.sum() == 1
    assert counts.patches[1].get_data().values.tolist() == [1]
    assert whole.lines[0].get_ydata()[-1] == 478.0
    cut_K = 10.0 * tiny_plan.stability.tolerance_K
    assert close.lines[0].get_ydata()[0] == -min(10.0, cut_K)
    text = live_page(seen, shot, over=True, epoch_s=0.0)
    assert "7.6e-05 % of the pixels are saturated" in text and "highest 16383" in text


@pytest.mark.parametrize(
    "image", [np.zeros((1, 1)), np.full((2, 3, 500), 7), np.full((500, 3), 65535)]
)
def test_any_image_can_be_shown(image: np.ndarray[Any, Any]) -> None:
    page = live_page(Seen(state="recording"), LastShot(image.astype(np.uint16), _META),
                     over=False, epoch_s=0.0)  # fmt: skip
    assert "data:image/png" in page and "The recording has not begun." in page


def test_acquire_live(tiny_rig: dict[str, Any], tiny_plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(tiny_rig))
    (tmp_path / "plan.yaml").write_text(tiny_plan.dump())
    files = (tmp_path / "rig.yaml", tmp_path / "plan.yaml")
    said = command("acquire", *files, "--live", "--out", tmp_path / "a").output
    assert "10 of 10 shots" in said and "page: " in said
    assert "finished" in (tmp_path / "a" / "live.html").read_text(encoding="utf-8")
