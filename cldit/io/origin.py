"""Origin of a result: date, command, machine, code, seeds and the files that were read."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from cldit.errors import FileError
from cldit.io.files import read_text

# Packages that affect the numbers; those that are not installed are omitted.
_COMPUTE = ("cldit", "numpy", "scipy", "pyopencl", "CoolProp", "miepython", "tifffile")

ROOMS = {
    "spray": "spray",
    "cfd": "spray",
    "optics": "optics",
    "medium": "cells",
    "prepare": "cells",
    "camera": "pixels",
    "transport": "seed",
    "kernels": "seed",
}
"""Rooms whose sources make an image, and the part of a run that each makes."""


@dataclass(frozen=True)
class FileRead:
    """State of a file when it was read: absolute path, size, date in UTC (ISO 8601), SHA-256."""

    path: str
    bytes: int
    modified: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> FileRead:
        """Record of a file; OSError if it cannot be read."""
        with path.open("rb") as stream:
            sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        status = path.stat()
        modified = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
        return cls(str(path.resolve()), status.st_size, modified, sha256)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FileRead:
        """Reads what `to_dict` gave."""
        return cls(
            str(data["path"]), int(data["bytes"]), str(data["modified"]), str(data["sha256"])
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)

    @property
    def change(self) -> str:
        """Change since the file was read, as text; empty if it is the same."""
        try:
            current = FileRead.of(Path(self.path))
        except OSError as error:
            return f"cannot be read ({error.strerror or error})"
        if current.sha256 == self.sha256:
            return ""
        return (
            f"has changed ({self.bytes} bytes of {self.modified} then, {current.bytes} bytes of "
            f"{current.modified} now)"
        )

    @property
    def text(self) -> str:
        """Description on one line."""
        size = f"{self.bytes} bytes, {self.modified}, sha256 {self.sha256[:12]}"
        return f"read {self.path} ({size})"


def files_read(paths: Iterable[Path]) -> tuple[FileRead, ...]:
    """Records of the files, and of all in folders, each once, in order; OSError if one cannot be
    read.
    """
    members = (
        member
        for path in paths
        for member in (sorted(path.rglob("*")) if path.is_dir() else (path,))
    )
    files = dict.fromkeys(member.resolve() for member in members if not member.is_dir())
    return tuple(FileRead.of(path) for path in files)


@dataclass(frozen=True)
class Origin:
    """Origin stored beside a result.

    date: UTC, ISO 8601. command: program and arguments, the home folder as `~`; of a script, its
    name. processor, system: kind of the host, which is not named. commit: of the checkout that
    cldit is installed from, with `+changes` if sources differ from it; None: no checkout. code:
    digests of the sources by room; empty in older results. seeds: by the scene's keys. inputs:
    files that the result was made from. scene_sha256: of scene.yaml.
    """

    date: str
    command: tuple[str, ...]
    processor: str
    cores: int
    system: str
    commit: str | None = None
    seeds: dict[str, int] | None = None
    inputs: tuple[FileRead, ...] = ()
    scene_sha256: str = ""
    code: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def now(
        cls,
        *,
        inputs: Sequence[FileRead] = (),
        scene: Mapping[str, Any] | None = None,
        scene_sha256: str = "",
    ) -> Origin:
        """Origin of a result of this process, made from `inputs`, and from a `scene` as plain data
        with the seeds, whose text has the digest `scene_sha256`.
        """
        return cls(
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            command=_command(sys.argv),
            processor=processor(),
            cores=os.cpu_count() or 1,
            system=platform.platform(),
            commit=commit(),
            seeds=None if scene is None else dict(_seeds(scene)),
            inputs=tuple(inputs),
            scene_sha256=scene_sha256,
            code=code(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)

    @property
    def text(self) -> dict[str, str]:
        """Texts for readers, by name."""
        shown = {
            "computed": f"{self.date}, on {self.processor} ({self.cores} cores), {self.system}"
        }
        if self.command:
            shown["command"] = " ".join(self.command)
        if self.commit is not None:
            shown["commit"] = self.commit
        if self.seeds:
            shown["seeds"] = ", ".join(f"{key}: {seed}" for key, seed in self.seeds.items())
        return shown


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that affect results, by name."""
    installed = {}
    for name in _COMPUTE:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return {**installed, "python": platform.python_version()}


@cache
def processor() -> str:
    """Model of the processor, as named by the system."""
    with suppress(FileError):
        for line in read_text(Path("/proc/cpuinfo")).splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


@cache
def code() -> dict[str, str]:
    """Digest of the sources by room of cldit, for those that compute an image."""
    digests = {}
    for room in ROOMS:
        digest = hashlib.sha256()
        for path in sorted(
            _sources(resources.files(f"cldit.{room}")), key=lambda source: source.name
        ):
            digest.update(path.name.encode() + path.read_bytes())
        digests[room] = digest.hexdigest()[:16]
    return digests


def _sources(folder: Traversable) -> Iterator[Traversable]:
    for path in folder.iterdir():
        if path.is_dir():
            yield from _sources(path)
        elif path.name.endswith((".py", ".cl", ".h")):
            yield path


@cache
def commit() -> str | None:
    """Commit of the checkout that cldit is installed from; None without a checkout or git."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():  # a folder above may be a checkout of something else
        return None
    try:
        revision = _git(root, "rev-parse", "HEAD")
        changed = _git(root, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return f"{revision}+changes" if changed else revision


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(
        ["git", "--no-optional-locks", "-C", str(root), *words],
        capture_output=True,
        text=True,
        check=True,
        timeout=30.0,
    )
    return done.stdout.strip()


def _command(words: Sequence[str]) -> tuple[str, ...]:
    """Command line without the folders of the program and of the user."""
    if not words or not words[0]:
        return ()
    program = Path(words[0])
    name = program.parent.name if program.name == "__main__.py" else program.name
    home = os.path.expanduser("~")
    if len(home) < 2:
        return (name, *words[1:])
    folder = re.compile(re.escape(home) + r"(?=[/\\]|$)")
    return (name, *(folder.sub("~", word) for word in words[1:]))


def _seeds(data: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, int]]:
    for key, value in data.items():
        if isinstance(value, Mapping):
            yield from _seeds(value, f"{path}{key}.")
        elif key == "seed" and isinstance(value, int):
            yield f"{path}{key}", value
