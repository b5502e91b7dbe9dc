"""Records of the files that a result was made from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


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
            found = hashlib.file_digest(stream, "sha256").hexdigest()
        status = path.stat()
        modified = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
        return cls(str(path.resolve()), status.st_size, modified, found)

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
    def unchanged(self) -> bool:
        """True if the file is the same as when it was read."""
        path = Path(self.path)
        try:
            return path.stat().st_size == self.bytes and FileRead.of(path).sha256 == self.sha256
        except OSError:
            return False

    @property
    def text(self) -> str:
        """Description on one line."""
        size = f"{self.bytes} bytes, {self.modified}, sha256 {self.sha256[:12]}"
        return f"read {self.path} ({size})"


def files_read(paths: Iterable[Path]) -> tuple[FileRead, ...]:
    """Records of the files, each once, in order; OSError if one cannot be read."""
    return tuple(FileRead.of(path) for path in dict.fromkeys(each.resolve() for each in paths))
