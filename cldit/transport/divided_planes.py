"""Images and means of paths, of which each part of a device computes some pixels."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.gpu.buffers import download, unset
from cldit.gpu.device import Device, shares


def divided_planes(
    device: Device,
    label: str,
    shape: tuple[int, int],
    dtype: type[np.generic],
    launch: Callable[[int, slice, Any], None],
) -> NDArray[Any]:
    """Planes (P, N), this `shape`, of which each part of a device computes some of the N columns.

    `launch` takes the number of the part, its columns, and a buffer of its planes, which it fills
    without waiting; `label` as in `unset`.
    """
    planes, count = shape
    outs = []
    for number, (member, portion) in enumerate(shares(device, count)):
        out = unset(member, label, planes * len(portion), dtype)
        if portion:
            launch(number, slice(portion.start, portion.stop), out)
            member.queue.flush()  # the next device starts while this one works
        outs.append((member, out, len(portion)))
    parts = [
        download(member, out, np.empty((planes, columns), dtype))
        for member, out, columns in outs
        if columns
    ]
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
