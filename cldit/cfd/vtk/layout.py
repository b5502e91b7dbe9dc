"""VTK files of a path: foamToVTK's folders, ParaView's collections, single files."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cldit.cfd.tolerances import ROUNDED
from cldit.cfd.vtk.collections import (
    COLLECTIONS,
    DATA,
    Entry,
    entries,
    pvd_steps,
    series,
    stem,
    step_of,
    without_step,
)
from cldit.cfd.vtk.composite import COMPOSITE, times_in
from cldit.errors import SprayError

_PLACES = ("lagrangian/*/*", "lagrangian/*", "*/lagrangian/*/*", "*/lagrangian/*")
_CLOUDS = tuple(f"{place}.{kind}" for place in _PLACES for kind in ("vtp", "vtk", "vtu"))


@dataclass(frozen=True)
class Layout:
    """Data sets by step; times by step, if a list states them.

    listed: steps, times and files in each `.series`, missing files too. named_step: that of a file.
    read: files that were read for this. left_out: files of which nothing is used. beside: files
    next to the named one that it does not include, and that may be its parcels.
    """

    steps: dict[str, list[Entry]]
    times: dict[str, float] = field(default_factory=dict)
    listed: Mapping[Path, list[tuple[str, float, Path]]] = field(default_factory=dict)
    read: tuple[Path, ...] = ()
    left_out: tuple[Path, ...] = ()
    beside: tuple[Path, ...] = ()
    named_step: str | None = None
    remarks: tuple[str, ...] = ()


def is_vtk(folder: Path) -> bool:
    """True if a folder holds VTK files, or lies in output of foamToVTK."""
    return bool(_files(folder)) or _foam_folder(folder) is not None


def find_layout(path: Path) -> Layout:
    """Layout of `path`, a file or folder. A file restricts the search to itself."""
    if not path.exists():
        raise SprayError(f"{path}: no such file or folder (spray.file)")
    path = path.resolve()
    folder = _foam_folder(path)
    if folder is not None:
        return _foam(folder, path)
    if path.is_dir():
        return _folder(path)
    if path.suffix == ".pvd":
        return _pvd([path])
    if path.suffix == ".series":
        return _folder(path.parent)
    if path.suffix in COMPOSITE and (times := times_in(path)):
        steps = {repr(t): [Entry(stem(path), (path,), time_s=t)] for t in times}
        return Layout(steps, {repr(time): time for time in times})
    data_sets = entries(path)
    neighbours = [file for file in _files(path.parent) if file.suffix in (".vtp", ".pvtp")]
    ours = {piece for entry in data_sets for piece in (*entry.pieces, *entry.named_by)} | {path}
    beside = [file for file in neighbours if file not in ours and step_of(file) == step_of(path)]
    return Layout({"": data_sets}, beside=tuple(beside))


def _files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix in (*DATA, *COLLECTIONS, ".pvd"))


def _foam_folder(path: Path) -> Path | None:
    """Top folder of foamToVTK's layout, if the path lies in one."""
    top = path if path.is_dir() else path.parent
    for folder in (top, top.parent):
        if folder.name == "lagrangian":
            top = folder.parent
    if path != top and (top / "internal.vtu").is_file() and re.search(r"_\d+$", top.name):
        top = top.parent
    elif (top / "internal.vtu").is_file() and (top.parent / "lagrangian").is_dir():
        top = top.parent
    marks = ("internal.vtu", "*/internal.vtu", "lagrangian", "*/lagrangian")
    converted = any(any(top.glob(mark)) for mark in marks)
    return top if converted else None


def _foam(folder: Path, path: Path) -> Layout:
    """Steps by number; boundary patches, which lie deeper or elsewhere, are ignored."""
    steps: dict[str, list[Entry]] = {}
    for pattern in ("*.vtu", "*.vtk", "*/internal.vtu"):
        for file in sorted(folder.glob(pattern)):
            entry = Entry("internal", (file,), cloud=False)
            steps.setdefault(step_of(file.relative_to(folder)), []).append(entry)
    for pattern in _CLOUDS:
        for file in sorted(folder.glob(pattern)):
            inside = file.relative_to(folder)
            cloud_file = Path(inside.parts[inside.parts.index("lagrangian") + 1])
            entry = Entry(without_step(stem(cloud_file)), (file,), cloud=True)
            steps.setdefault(step_of(inside), []).append(entry)
    lists = [item for glob in ("*.series", "lagrangian/*/*.series") for item in folder.glob(glob)]
    listed = {file: series(file) for file in sorted(lists)}
    times = _times_of(listed)
    step = None
    if path != folder and path.suffix != ".series":
        step = step_of(path.relative_to(folder))
        named = [item for item in steps.get(step, []) if path in item.pieces]
        if named:  # no other file of its kind
            steps[step] = named + [item for item in steps[step] if item.cloud != named[0].cloud]
    return Layout(steps, times, listed, read=tuple(listed), named_step=step)


def _folder(folder: Path) -> Layout:
    """Folder of files: every .pvd together, else all files that no collection names."""
    files = _files(folder)
    for file in files:
        if file.suffix in COMPOSITE and times_in(file):
            raise SprayError(f"{file}: has several times in it; give this file as the case")
    if lists := [item for item in files if item.suffix == ".pvd"]:
        layout = _pvd(lists)
        used = [entry for group in layout.steps.values() for entry in group]
        taken = {piece for entry in used for piece in (*entry.pieces, *entry.named_by)}
        return replace(layout, left_out=tuple(item for item in files if item not in taken))
    by_file = {file: entries(file) for file in files}
    listing = [entry for group in by_file.values() for entry in group if entry.named_by]
    named = {piece for entry in listing for piece in (*entry.pieces, *entry.named_by[1:])}
    steps: dict[str, list[Entry]] = {}
    for file, group in by_file.items():
        if file not in named:
            steps.setdefault(step_of(Path(file.name)), []).extend(group)
    listed = {file: series(file) for file in sorted(folder.glob("*.series"))}
    times = _times_of(listed)
    return Layout(steps, times, listed, read=tuple(listed))


def _times_of(listed: Mapping[Path, list[tuple[str, float, Path]]]) -> dict[str, float]:
    """Time of each step of the lists; refuses one of two times, as of lists of several runs."""
    times: dict[str, tuple[float, Path]] = {}
    for file, items in listed.items():
        for step, time_s, _ in items:
            known_s, known_file = times.setdefault(step, (time_s, file))
            if abs(time_s - known_s) > ROUNDED * max(abs(time_s), abs(known_s)):
                rival = f"{known_file} at {known_s:.9g} s"
                way = "allowed: one time of each step; keep the lists and files of one run"
                raise SprayError(f"{file}: lists step {step} at {time_s:.9g} s, {rival}; {way}")
    return {step: time_s for step, (time_s, _) in times.items()}


def _pvd(lists: list[Path]) -> Layout:
    steps: dict[str, list[Entry]] = {}
    times: dict[str, float] = {}
    remarks: tuple[str, ...] = ()
    for file in lists:
        named, back = pvd_steps(file)
        remarks += back
        for time, data_sets in named.items():
            close = (k for k, t in times.items() if abs(t - time) <= ROUNDED * abs(t))
            key = next(close, repr(time))
            times.setdefault(key, time)
            steps.setdefault(key, []).extend(data_sets)
    if not steps:
        raise SprayError(f"{lists[0]}: names no file")
    return Layout(steps, times, read=tuple(lists), remarks=remarks)
