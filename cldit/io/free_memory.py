"""Memory that this process may still take, and parts of arrays that stay in the cache."""

import sys
from collections.abc import Iterator
from pathlib import Path

_CACHED = 1 << 16  # numbers of an array, half a megabyte: a few of them stay in a core's cache
_GROUPS = Path("/sys/fs/cgroup")


def parts(count: int) -> Iterator[slice]:
    """Consecutive parts of `count` elements, for element-wise work in the cache."""
    for begin in range(0, count, _CACHED):
        yield slice(begin, min(begin + _CACHED, count))


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
    memory = _fields(Path("/proc/meminfo"))
    if "MemAvailable" in memory:
        yield memory["MemAvailable"] * 1024


def _groups() -> Iterator[int]:
    """Rest of this process's control group and of each above it (version 2)."""
    try:
        listing = Path("/proc/self/cgroup").read_text(encoding="utf-8")
    except OSError:
        return
    group_path = next((line[3:] for line in listing.splitlines() if line.startswith("0::")), None)
    if group_path is None:
        return
    innermost = _GROUPS / group_path.lstrip("/")
    for group in [innermost, *innermost.parents]:
        if not group.is_relative_to(_GROUPS):
            return
        try:
            limit = (group / "memory.max").read_text(encoding="utf-8").strip()
            used = int((group / "memory.current").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if limit.isdigit():
            # cached pages of files count as used, but are released on demand
            yield max(int(limit) - used + _fields(group / "memory.stat").get("inactive_file", 0), 0)


def _limit() -> Iterator[int]:
    import resource  # missing on Windows

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY:
        taken = _fields(Path("/proc/self/status")).get("VmSize", 0) * 1024
        yield max(limit - taken, 0)
