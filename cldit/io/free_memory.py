"""Memory that this process may still take."""

import sys
from collections.abc import Iterator
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")


def free_bytes() -> int | None:
    """Memory that can be taken without swapping; None if unknown.

    On Linux, the least of the kernel's available memory, the rest of this process's control groups
    (containers, batch jobs), and `ulimit -v`.
    """
    if not sys.platform.startswith("linux"):
        return None
    return min([*_machine(), *_groups(), *_limit()], default=None)


def _fields(path: Path) -> dict[str, int]:
    """Lines of a name and a number; empty if there is no such file."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    parts = [line.replace(":", " ").split() for line in lines]
    return {part[0]: int(part[1]) for part in parts if len(part) > 1 and part[1].isdigit()}


def _machine() -> Iterator[int]:
    known = _fields(Path("/proc/meminfo"))
    if "MemAvailable" in known:
        yield known["MemAvailable"] * 1024


def _groups() -> Iterator[int]:
    """Rest of this process's control group and of each above it (version 2)."""
    try:
        text = Path("/proc/self/cgroup").read_text(encoding="utf-8")
    except OSError:
        return
    own = next((line[3:] for line in text.splitlines() if line.startswith("0::")), None)
    if own is None:
        return
    here = _GROUPS / own.lstrip("/")
    for group in [here, *here.parents]:
        if not group.is_relative_to(_GROUPS):
            return
        try:
            most = (group / "memory.max").read_text(encoding="utf-8").strip()
            used = int((group / "memory.current").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if most.isdigit():
            # cached pages of files count as used, but are released on demand
            yield max(int(most) - used + _fields(group / "memory.stat").get("inactive_file", 0), 0)


def _limit() -> Iterator[int]:
    import resource  # missing on Windows

    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY:
        taken = _fields(Path("/proc/self/status")).get("VmSize", 0) * 1024
        yield max(most - taken, 0)
