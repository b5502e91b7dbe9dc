"""OpenCL devices: the list of them, the choice of one, and the reason for it."""

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import pyopencl as cl

from cldit.errors import DeviceError
from cldit.gpu.context import Context, Lease, OpenDevices
from cldit.gpu.pocl import instruction_sets, mistaken_for, name_processor
from cldit.io.extras import install_line

_NO_DRIVER = "no OpenCL platform was found; install a driver, or one for any processor: "


@dataclass(frozen=True)
class DeviceInfo:
    """Properties of a device, for the choice of one."""

    index: str  # platform:device, as --device takes it
    platform: str
    name: str
    kind: str  # cpu, gpu, accelerator
    version: str
    driver: str
    compute_units: int
    memory_bytes: int
    largest_buffer_bytes: int
    float64: bool
    largest_group: int = 256  # work-items in one work-group

    @property
    def tile(self) -> int:
        """Edge of the largest square work-group, a power of two up to 16."""
        return next(edge for edge in (16, 8, 4, 2, 1) if edge**2 <= max(self.largest_group, 1))


@dataclass(frozen=True)
class Device:
    """A device that is open until `close`.

    reason: why it was chosen. others: further devices that share the pixels of an image. lease: of
    the context, which all uses of the device in a process share, threads included. poison: fresh
    buffers contain NaN, or the largest integer, so that tests find reads of unwritten memory.
    watch: called after each launch with the program, the kernel and its arguments by name.
    """

    info: DeviceInfo
    reason: str
    lease: Lease
    others: "tuple[Device, ...]" = ()
    poison: bool = False
    watch: Callable[[Any, str, Mapping[str, Any]], None] | None = None

    @property
    def is_cpu(self) -> bool:
        """True if the device is a CPU."""
        return self.info.kind == "cpu"

    @property
    def opened(self) -> Context:
        """Owner of context, queues and programs; raises DeviceError if closed, or in a fork."""
        return self.lease.context

    @property
    def context(self) -> Any:
        """The context of pyopencl."""
        return self.opened.opencl

    @property
    def queue(self) -> Any:
        """The queue of pyopencl for this thread."""
        return self.opened.queue

    def close(self) -> None:
        """Gives the device up; its memory is freed when no other `open_device` uses it."""
        for device in (self, *self.others):
            device.lease.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def poisoned(self) -> "Device":
        """The same device, and its others, with `poison`."""
        return replace(self, poison=True, others=tuple(device.poisoned() for device in self.others))


# The devices that are open in this process; see context.py for how long.
_OPEN = OpenDevices()


def _described_devices() -> list[tuple[DeviceInfo, Any]]:
    _OPEN.check_process()
    try:
        platforms = cl.get_platforms()
    except cl.LogicError as error:
        raise DeviceError(_NO_DRIVER + install_line("pocl")) from error
    described: list[tuple[DeviceInfo, Any]] = []
    for p, platform in enumerate(platforms):
        try:
            devices = platform.get_devices()
        except cl.LogicError:
            continue  # some loaders list platforms without devices
        for d, device in enumerate(devices):
            described.append((_describe(f"{p}:{d}", platform, device), device))
    if not described:
        raise DeviceError(_NO_DRIVER + install_line("pocl"))
    return described


def _describe(index: str, platform: Any, device: Any) -> DeviceInfo:
    kinds = {cl.device_type.CPU: "cpu", cl.device_type.GPU: "gpu"}
    kind = next((name for bit, name in kinds.items() if device.type & bit), "accelerator")
    return DeviceInfo(
        index=index,
        platform=platform.name.strip(),
        name=device.name.strip(),
        kind=kind,
        version=device.version.strip(),
        driver=device.driver_version.strip(),
        compute_units=device.max_compute_units,
        memory_bytes=device.global_mem_size,
        largest_buffer_bytes=device.max_mem_alloc_size,
        float64=bool(device.double_fp_config),
        largest_group=device.max_work_group_size,
    )


def list_devices() -> list[DeviceInfo]:
    """All OpenCL devices of this machine.

    Returns:
        The devices, in the order of their indices `platform:device`.

    Raises:
        DeviceError: there is none (the message says what to install), or this process is a fork of
            one that had used OpenCL.
    """
    return [info for info, _ in _described_devices()]


def choose(
    devices: list[DeviceInfo], request: str | None, failed: Collection[str] = ()
) -> tuple[int, str]:
    """Number in `devices` of the one that `open_device` opens, and the reason.

    Without a name, none of the `failed` is chosen, indices of devices that failed their check.
    """
    if request is not None:
        for number, info in enumerate(devices):
            if request == info.index:
                return number, f"requested as {request}"
        for number, info in enumerate(devices):
            if request.lower() in f"{info.platform} {info.name} {info.kind}".lower():
                return number, f"the first whose name contains {request!r}"
        available = "; ".join(f"{info.index} {info.name}" for info in devices)
        raise DeviceError(f"device: {request!r} does not exist; allowed: {available}")
    passed = [number for number, info in enumerate(devices) if info.index not in failed]
    without = f"; failed their check: {', '.join(sorted(failed))}" if failed else ""
    if not passed:
        raise DeviceError(f"device: none is usable{without} (`cldit devices --check` says why)")
    gpus = [number for number in passed if devices[number].kind == "gpu"]
    if gpus:
        best = max(gpus, key=lambda number: devices[number].memory_bytes)
        return best, f"the GPU with the most memory{without}"
    best = max(passed, key=lambda number: devices[number].compute_units)
    return best, f"no GPU here; the device with the most compute units{without}"


def open_device(request: str | None = None, failed: Collection[str] = ()) -> Device:
    """Opens a device, or several that share the work, as `cldit.opencl_device` without its check.

    `failed` are indices of devices that are not chosen without their name.
    """
    described = _described_devices()
    if request is not None and "," in request:
        names = [name.strip() for name in request.split(",")]
        numbers = [choose([info for info, _ in described], name)[0] for name in names]
        if len(set(numbers)) < len(numbers):
            raise DeviceError(f"device: {request!r} names one device more than once")
        main, *further = (
            _open(*described[number], f"requested in {request}") for number in numbers
        )
        return replace(main, others=tuple(further))
    number, reason = choose([info for info, _ in described], request, failed)
    return _open(*described[number], reason)


def split(device: Device, counts: Sequence[int]) -> Device:
    """Divides a device into parts of so many compute units each (clCreateSubDevices)."""
    handle = device.opened.handle
    try:
        cut = cl.device_partition_property
        parts = handle.create_sub_devices([cut.BY_COUNTS, *counts, cut.BY_COUNTS_LIST_END])
    except cl.Error as error:
        raise DeviceError(
            f"{device.info.name} cannot be divided into {list(counts)}: {error}"
        ) from error
    described = (
        _describe(f"{device.info.index}.{n}", handle.platform, part) for n, part in enumerate(parts)
    )
    main, *further = (
        _open(replace(info, version=device.info.version), part, "a part of it", keep=False)
        for info, part in zip(described, parts, strict=True)
    )
    return replace(main, others=tuple(further))


def _open(info: DeviceInfo, handle: Any, reason: str, *, keep: bool = True) -> Device:
    try:
        lease = _OPEN.lease(handle, keep=keep, prepare=lambda: _version(info, handle))
    except cl.Error as error:
        raise DeviceError(f"device {info.index} ({info.name}) cannot be opened: {error}") from error
    return Device(replace(info, version=lease.context.version), reason, lease)


def _version(info: DeviceInfo, handle: Any) -> str:
    """The driver's version, with the correct name of the processor if PoCL has a wrong one."""
    flags = instruction_sets()
    mistaken = mistaken_for(handle.platform, handle, flags)
    name = None if mistaken is None else name_processor(handle, mistaken, flags)
    if mistaken is None or name is None:  # in the latter case the first build may explain
        return info.version
    return info.version.removesuffix(mistaken.decode()) + name.decode()


def shares(device: Device, count: int) -> list[tuple[Device, range]]:
    """Range of `count` rows or pixels for each device, in proportion to its compute units."""
    devices = (device, *device.others)
    units = [0, *itertools.accumulate(member.info.compute_units for member in devices)]
    bounds = [round(count * unit / units[-1]) for unit in units]
    pairs = zip(devices, itertools.pairwise(bounds), strict=True)
    return [(member, range(start, stop)) for member, (start, stop) in pairs]
