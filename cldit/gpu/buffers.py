"""Arrays in device memory."""

from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.errors import DeviceError
from cldit.gpu.device import Device


class Numbers(cl.Buffer):
    """A buffer with the type of its numbers, against which a kernel's argument is checked."""

    dtype: type[np.generic]


def _buffer(device: Device, flags: Any, dtype: Any, **content: Any) -> Numbers:
    out = Numbers(device.context, flags, **content)
    out.dtype = np.dtype(dtype).type
    return out


def check_size(device: Device, label: str, size: int) -> None:
    """Raises DeviceError with the `label` of the content if no buffer takes `size` bytes."""
    if size > device.info.largest_buffer_bytes:
        raise DeviceError(
            f"{label}: {size / 1e9:.2f} GB is more than {device.info.name} takes in one buffer "
            f"({device.info.largest_buffer_bytes / 1e9:.2f} GB); allowed: a larger "
            "domain.leaf_edge_m, or another device"
        )


def upload(device: Device, label: str, array: NDArray[Any]) -> Any:
    """Copies an array to a new buffer, which has one element of padding if the array is empty.

    `label` names the content in errors; see `check_size`.
    """
    data = np.ascontiguousarray(array)
    if data.nbytes == 0:
        data = np.zeros(1, data.dtype)
    check_size(device, label, data.nbytes)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    return _buffer(device, flags, data.dtype, hostbuf=data)


def unset(device: Device, label: str, count: int, dtype: type[np.generic]) -> Any:
    """Allocates a buffer of `count` numbers, one at least, that are undefined until written.

    `label` names the content in errors; see `check_size`.
    """
    size = max(1, count) * np.dtype(dtype).itemsize
    check_size(device, label, size)
    buffer = _buffer(device, cl.mem_flags.READ_WRITE, dtype, size=size)
    if device.poison:
        cl.enqueue_fill_buffer(device.queue, buffer, _poison(dtype), 0, size)
    return buffer


def _poison(dtype: type[np.generic]) -> NDArray[Any]:
    """A number of the type that is conspicuous wherever it is read."""
    number = np.iinfo(dtype).max if issubclass(dtype, np.integer) else np.nan
    return np.full(1, number, dtype)


def zeros(device: Device, label: str, count: int, dtype: type[np.generic]) -> Any:
    """Allocates a buffer of zeros, otherwise as `unset`."""
    buffer = unset(device, label, count, dtype)
    clear(device, buffer, max(1, count), dtype)
    return buffer


def clear(device: Device, buffer: Any, count: int, dtype: type[np.generic]) -> None:
    """Sets the first `count` numbers of a buffer to 0."""
    if count:
        zero = np.zeros(1, np.uint8)
        cl.enqueue_fill_buffer(device.queue, buffer, zero, 0, count * np.dtype(dtype).itemsize)


def download(device: Device, buffer: Any, out: NDArray[Any], *, start: int = 0) -> NDArray[Any]:
    """Fills `out`, a contiguous array of the buffer's type, from number `start` of the buffer on.

    Waits until the copy is done, and returns `out`.
    """
    if out.size:
        cl.enqueue_copy(device.queue, out, buffer, src_offset=start * out.itemsize)
    return out
