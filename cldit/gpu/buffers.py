"""Arrays on the device, and the time that kernels take."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from cldit.errors import DeviceError
from cldit.gpu.device import Device


class Numbers(cl.Buffer):
    """A buffer that knows the type of its numbers, so that a kernel is given no others."""

    dtype: type[np.generic]


def _buffer(device: Device, flags: Any, dtype: Any, **content: Any) -> Numbers:
    out = Numbers(device.context, flags, **content)
    out.dtype = np.dtype(dtype).type
    return out


def check_size(device: Device, what: str, size: int) -> None:
    """Refuses a buffer of `size` bytes for `what`, where `device` cannot hold it in one piece.

    Raises:
        DeviceError: names the buffer, its size, and the limit.
    """
    if size > device.info.largest_buffer_bytes:
        raise DeviceError(
            f"{what}: {size / 1e9:.2f} GB is more than {device.info.name} takes in one buffer "
            f"({device.info.largest_buffer_bytes / 1e9:.2f} GB); set domain.leaf_edge_m coarser"
        )


def upload(device: Device, what: str, array: NDArray[Any]) -> Any:
    """A device buffer with an array's content; an empty array gets one element of padding.

    Args:
        device: holds the buffer.
        what: names the content in the error of `check_size`.
        array: of any shape.
    """
    data = np.ascontiguousarray(array)
    if data.nbytes == 0:
        data = np.zeros(1, data.dtype)
    check_size(device, what, data.nbytes)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    return _buffer(device, flags, data.dtype, hostbuf=data)


def unset(device: Device, what: str, count: int, dtype: type[np.generic]) -> Any:
    """A device buffer whose numbers are undefined until they are written.

    Args:
        device, what: as in `upload`.
        count: how many numbers; one is allocated at least.
        dtype: of a number.
    """
    size = max(1, count) * np.dtype(dtype).itemsize
    check_size(device, what, size)
    buffer = _buffer(device, cl.mem_flags.READ_WRITE, dtype, size=size)
    if device.poison:
        cl.enqueue_fill_buffer(device.queue, buffer, _poison(dtype), 0, size)
    return buffer


def _poison(dtype: type[np.generic]) -> NDArray[Any]:
    """A number of the type that shows wherever it is read."""
    number = np.iinfo(dtype).max if issubclass(dtype, np.integer) else np.nan
    return np.full(1, number, dtype)


def zeros(device: Device, what: str, count: int, dtype: type[np.generic]) -> Any:
    """A device buffer of zeros.

    Args:
        device, what, count, dtype: as in `unset`.
    """
    buffer = unset(device, what, count, dtype)
    clear(device, buffer, max(1, count), dtype)
    return buffer


def clear(device: Device, buffer: Any, count: int, dtype: type[np.generic]) -> None:
    """Sets the first `count` numbers of type `dtype` in a `buffer` of `device` to 0."""
    if count:
        zero = np.zeros(1, np.uint8)
        cl.enqueue_fill_buffer(device.queue, buffer, zero, 0, count * np.dtype(dtype).itemsize)


def download(device: Device, buffer: Any, out: NDArray[Any], *, first: int = 0) -> NDArray[Any]:
    """Copies as much of a buffer as `out` takes, and waits for it.

    Args:
        device: holds the buffer.
        buffer: of numbers in the type of `out`.
        out: contiguous, of any shape.
        first: number in the buffer from which it is copied.

    Returns:
        `out`.
    """
    if out.size:
        cl.enqueue_copy(device.queue, out, buffer, src_offset=first * out.itemsize)
    return out
