"""Images in files that hold little else: .npy and .png."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from cldit.acquisition.pictures.source import Source
from cldit.io.files import check_regular, open_regular


def open_npy(source: Source) -> NDArray[Any]:
    """An array as numpy saves it, (rows, columns) or with three axes; it stays in the file."""
    check_regular(source.path)
    if source.incomplete:
        return _whole_images(source)
    return np.asarray(np.load(source.path, mmap_mode="r", allow_pickle=False))


def _whole_images(source: Source) -> NDArray[Any]:
    """Complete images of an array whose file ended early."""
    with open_regular(source.path) as stream:
        major, _ = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0
        shape, fortran, dtype = (read if major == 1 else np.lib.format.read_array_header_2_0)(
            stream
        )
        if fortran or len(shape) != 3:
            raise ValueError(f"shape {shape}, expected (frames, rows, columns) in C order")
        offset, size = stream.tell(), source.path.stat().st_size
    count = min(shape[0], (size - offset) // (shape[1] * shape[2] * dtype.itemsize))
    return np.memmap(source.path, dtype, "r", offset, (count, *shape[1:]))


def open_png(source: Source) -> NDArray[Any]:
    """Reads a grey image of 8 or 16 bits; raises ValueError for colours."""
    with open_regular(source.path) as stream, Image.open(stream) as image:
        if image.mode not in ("L", "I", "I;16", "I;16B"):
            raise ValueError(
                f"mode {image.mode} holds colours, not counts; export grey images of 16 bits"
            )
        return np.array(image)
