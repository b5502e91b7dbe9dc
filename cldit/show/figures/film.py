"""Pictures in turn as a film: animated GIF by Pillow, MP4 where imageio-ffmpeg is installed."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from cldit.io.files import whole, write_bytes

_MEAN_s = 0.25  # that a picture stands, in the mean
_LEAST_s, _MOST_s, _LAST_s = 0.04, 1.5, 1.0
_FRAMES_PER_S = 25  # of an MP4
_PLACES = np.array([65536, 256, 1], np.uint32)  # of red, green, blue in one number


def durations_s(times: Sequence[float]) -> list[float]:
    """How long each picture stands: as its time step is to the mean one, so that a spray does not
    seem to stop or to leap where times lie closer or farther apart.

    Args:
        times: of the pictures, rising.
    """
    if len(times) < 2:
        return [_LAST_s] * len(times)
    steps = np.diff(np.asarray(times, float))
    shown = np.clip(_MEAN_s * steps / steps.mean(), _LEAST_s, _MOST_s)
    return [*map(float, shown), _LAST_s]


def write_film(gif: Path, pictures: Sequence[bytes], times: Sequence[float]) -> list[Path]:
    """Writes an animated GIF, and an MP4 beside it if `mp4_possible`.

    Args:
        gif: its path.
        pictures: PNGs of one size, in their order.
        times: of the pictures, rising.

    Returns:
        The files.

    Raises:
        DiskFull, FileError: as `cldit.io.files.whole`.
    """
    stand_s = durations_s(times)
    made = [gif]
    write_bytes(made[0], gif_of(pictures, stand_s))
    if mp4_possible():
        made.append(gif.with_suffix(".mp4"))
        _write_mp4(made[1], pictures, stand_s)
    return made


def mp4_possible() -> bool:
    """Whether imageio-ffmpeg is installed (`pip install "cldit[film]"`)."""
    return find_spec("imageio_ffmpeg") is not None


def _rgb(png: bytes) -> NDArray[np.uint8]:
    """(H, W, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def gif_of(pictures: Sequence[bytes], stand_s: Sequence[float]) -> bytes:
    """An animated GIF that repeats itself for ever.

    All pictures share one table of 256 colours, so that what does not change does not flicker.

    Args:
        pictures: PNGs of one size.
        stand_s: how long each stands.
    """
    shown = _in_one_table(pictures)
    stream = io.BytesIO()
    shown[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=shown[1:],
        duration=[round(1e3 * each) for each in stand_s],
        loop=0,
        optimize=False,
    )
    return stream.getvalue()


def _in_one_table(pictures: Sequence[bytes]) -> list[Image.Image]:
    """Pictures with a table of 256 colours: black, white, and those that stand best for all others
    that occur, each of which counts once: by area, white paper would take most of the table.

    The nearest colour is looked for here, since Pillow takes one that is only near: white paper
    gets a tint.
    """
    # pictures are unpacked one at a time: all of a long series would not fit the memory
    codes = (_rgb(png).astype(np.uint32) @ _PLACES for png in pictures)
    known = np.unique(np.concatenate([np.unique(each) for each in codes]))
    seen = np.stack([known >> 16, known >> 8 & 255, known & 255], axis=1).astype(np.uint8)
    found = Image.fromarray(seen[None]).quantize(254, kmeans=4).getpalette() or []
    table = [0, 0, 0, 255, 255, 255, *found[: 3 * 254]]
    nearest = np.asarray(cKDTree(np.array(table).reshape(-1, 3)).query(seen)[1], np.uint8)
    shown = []
    for png in pictures:
        number = np.searchsorted(known, _rgb(png).astype(np.uint32) @ _PLACES)
        frame = Image.fromarray(nearest[number])
        frame.putpalette(table)
        shown.append(frame)
    return shown


def _write_mp4(path: Path, pictures: Sequence[bytes], stand_s: Sequence[float]) -> None:
    """H.264 at a constant rate, in which pictures are repeated."""
    from imageio_ffmpeg import write_frames

    first = _even(_rgb(pictures[0]))
    rows, columns = first.shape[:2]
    with whole(path) as part:
        writer = write_frames(
            str(part),
            (columns, rows),
            fps=_FRAMES_PER_S,
            macro_block_size=2,
            quality=8,
            output_params=["-f", "mp4"],  # the file's name does not end as one yet
        )
        with closing(writer):
            writer.send(None)
            for png, each_s in zip(pictures, stand_s, strict=True):
                pixels = np.ascontiguousarray(_even(_rgb(png)))
                for _ in range(max(1, round(each_s * _FRAMES_PER_S))):
                    writer.send(pixels)


def _even(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture (H, W, 3) without the last row or column where their number is odd: chroma of
    H.264 has half as many."""
    rows, columns = pixels.shape[:2]
    return pixels[: rows - rows % 2, : columns - columns % 2]
