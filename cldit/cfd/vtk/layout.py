"""VTK files of a path: foamToVTK's folders, ParaView's collections, single files."""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from cldit.cfd.times import TIME_TOLERANCE
from cldit.cfd.vtk.collections import (
    COLLECTIONS,
    DATA,
    Entry,
    Listed,
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

    listed: entries of `.series` files, whether the files exist or not. own: step of a named file.
    read: files that were read for this. left_out: files of which nothing is used. beside: files
    next to the named one that it does not include, and that may be its parcels.
    """

    steps: dict[str, list[Entry]]
    times: dict[str, float] = field(default_factory=dict)
    listed: tuple[Listed, ...] = ()
    read: tuple[Path, ...] = ()
    left_out: tuple[Path, ...] = ()
    beside: tuple[Path, ...] = ()
    own: str | None = None
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
    found = entries(path)
    near = [each for each in _files(path.parent) if each.suffix in (".vtp", ".pvtp")]
    ours = {piece for entry in found for piece in (*entry.pieces, *entry.named_by)} | {path}
    beside = [each for each in near if each not in ours and step_of(each) == step_of(path)]
    return Layout({"": found}, beside=tuple(beside))


def _files(folder: Path) -> list[Path]:
    return sorted(each for each in folder.iterdir() if each.suffix in (*DATA, *COLLECTIONS, ".pvd"))


def _foam_folder(path: Path) -> Path | None:
    """Top folder of foamToVTK's layout, if the path lies in one."""
    here = path if path.is_dir() else path.parent
    for folder in (here, here.parent):
        if folder.name == "lagrangian":
            here = folder.parent
    if path != here and (here / "internal.vtu").is_file() and re.search(r"_\d+$", here.name):
        here = here.parent
    elif (here / "internal.vtu").is_file() and (here.parent / "lagrangian").is_dir():
        here = here.parent
    marks = ("internal.vtu", "*/internal.vtu", "lagrangian", "*/lagrangian")
    found = any(any(here.glob(mark)) for mark in marks)
    return here if found else None


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
            after = Path(inside.parts[inside.parts.index("lagrangian") + 1])
            entry = Entry(without_step(stem(after)), (file,), cloud=True)
            steps.setdefault(step_of(inside), []).append(entry)
    lists = [each for glob in ("*.series", "lagrangian/*/*.series") for each in folder.glob(glob)]
    listed = tuple(each for file in sorted(lists) for each in series(file))
    times = {each.step: each.time_s for each in listed}
    own = None
    if path != folder and path.suffix != ".series":
        own = step_of(path.relative_to(folder))
        named = [each for each in steps.get(own, []) if path in each.pieces]
        if named:  # no other file of its kind
            steps[own] = named + [each for each in steps[own] if each.cloud != named[0].cloud]
    return Layout(steps, times, listed, read=tuple(sorted(lists)), own=own)


def _folder(folder: Path) -> Layout:
    """Folder of files: every .pvd together, else all files that no collection names."""
    files = _files(folder)
    for file in files:
        if file.suffix in COMPOSITE and times_in(file):
            raise SprayError(f"{file}: has several times in it; give this file as the case")
    if lists := [each for each in files if each.suffix == ".pvd"]:
        layout = _pvd(lists)
        every = [entry for found in layout.steps.values() for entry in found]
        taken = {each for entry in every for each in (*entry.pieces, *entry.named_by)}
        return replace(layout, left_out=tuple(each for each in files if each not in taken))
    found = {file: entries(file) for file in files}
    listing = [entry for each in found.values() for entry in each if entry.named_by]
    named = {piece for entry in listing for piece in (*entry.pieces, *entry.named_by[1:])}
    steps: dict[str, list[Entry]] = {}
    for file, each in found.items():
        if file not in named:
            steps.setdefault(step_of(Path(file.name)), []).extend(each)
    lists = sorted(folder.glob("*.series"))
    listed = tuple(each for file in lists for each in series(file))
    times = {each.step: each.time_s for each in listed}
    return Layout(steps, times, listed, read=tuple(lists))


def _pvd(lists: list[Path]) -> Layout:
    steps: dict[str, list[Entry]] = {}
    times: dict[str, float] = {}
    remarks: tuple[str, ...] = ()
    for file in lists:
        named, back = pvd_steps(file)
        remarks += back
        for time, found in named.items():
            near = (k for k, t in times.items() if abs(t - time) <= TIME_TOLERANCE * abs(t))
            key = next(near, repr(time))
            times.setdefault(key, time)
            steps.setdefault(key, []).extend(found)
    if not steps:
        raise SprayError(f"{lists[0]}: names no file")
    return Layout(steps, times, read=tuple(lists), remarks=remarks)
