"""Results of devices' checks, which `cldit.run.device_check` makes, in the cache.

A result holds for a device with its driver and for the kernels of this version.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from cldit.errors import ClditError
from cldit.gpu.device import DeviceInfo, list_devices
from cldit.io.caches import default_cache
from cldit.io.content import code_digest, digest
from cldit.io.files import make_folder, write_text
from cldit.io.plain_data import dump_yaml, read_mapping

_LOG = logging.getLogger("cldit")


@dataclass(frozen=True)
class Check:
    """Result of a check.

    faults: a line for each problem with a wrong result, which names the kernel; empty: passed.
    kernels: number of kernels that ran. seconds: wall time.
    """

    faults: tuple[str, ...]
    kernels: int
    seconds: float

    @property
    def text(self) -> str:
        """Result on one line."""
        return f"failed: {self.faults[0]}" if self.faults else f"passed, {self.kernels} kernels"


def tested(info: DeviceInfo) -> bool:
    """True for PoCL on a CPU, with which cldit's tests run; it is used without a check."""
    return info.platform == "Portable Computing Language" and info.kind == "cpu"


def stored_check(info: DeviceInfo) -> Check | None:
    """Result of the check of a device; None: not checked."""
    with suppress(ClditError, LookupError, TypeError):
        data = read_mapping(_place(info))
        return Check(tuple(data["faults"]), data["kernels"], data["seconds"])
    return None


def store_check(info: DeviceInfo, check: Check) -> None:
    """Stores the result of a check, if the cache can be written."""
    path = _place(info)
    try:
        make_folder(path.parent)
        write_text(path, dump_yaml({**asdict(check), "faults": list(check.faults)}))
    except OSError as error:
        _LOG.warning("%s: the check of %s cannot be stored (%s)", path, info.name, error)


def failed_devices() -> list[str]:
    """Indices of the devices that have failed their check."""
    checks = {info.index: stored_check(info) for info in list_devices()}
    return [index for index, check in checks.items() if check is not None and check.faults]


def _place(info: DeviceInfo) -> Path:
    """File of the check of a device."""
    identity = (info.platform, info.name, info.kind, info.driver, info.float64)
    return default_cache() / "devices" / f"{digest(identity, code_digest('kernels'))}.yaml"
