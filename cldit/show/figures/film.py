"""Films of images: animated GIF by Pillow, MP4 if imageio-ffmpeg is installed."""

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

_MEAN_s = 0.25  # that an image is shown, on average
_LEAST_s, _MOST_s, _LAST_s = 0.04, 1.5, 1.0
_FRAMES_PER_S = round(1.0 / _LEAST_s)  # of an MP4
_PLACES = np.array([65536, 256, 1], np.uint32)  # of red, green, blue in one number


def durations_s(times: Sequence[float]) -> list[float]:
    """Time that each image is shown, in proportion to its time step.

    So a spray does not seem to stop or to leap if times are closer or farther apart.
    """
    if len(times) < 2:
        return [_LAST_s] * len(times)
    steps = np.diff(np.asarray(times, float))
    shown = np.clip(_MEAN_s * steps / steps.mean(), _LEAST_s, _MOST_s)
    return [*map(float, shown), _LAST_s]


def write_film(gif: Path, images: Sequence[bytes], times: Sequence[float]) -> list[Path]:
    """Writes PNGs of one size as an animated GIF, and as MP4 if possible; returns the files."""
    shown_s = durations_s(times)
    files = [gif]
    write_bytes(files[0], gif_of(images, shown_s))
    if mp4_possible():
        files.append(gif.with_suffix(".mp4"))
        _write_mp4(files[1], images, shown_s)
    return files


def mp4_possible() -> bool:
    """True if imageio-ffmpeg is installed."""
    return find_spec("imageio_ffmpeg") is not None


def _rgb(png: bytes) -> NDArray[np.uint8]:
    """(H, W, 3)."""
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def gif_of(images: Sequence[bytes], shown_s: Sequence[float]) -> bytes:
    """Animated GIF of PNGs of one size, in an endless loop.

    All images share one palette of 256 colours, so constant parts do not flicker.
    """
    shown = _in_one_palette(images)
    stream = io.BytesIO()
    shown[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=shown[1:],
        duration=[round(1e3 * time_s) for time_s in shown_s],
        loop=0,
        optimize=False,
    )
    return stream.getvalue()


def _in_one_palette(images: Sequence[bytes]) -> list[Image.Image]:
    """Images with one palette: black, white, and 254 colours chosen for all that occur.

    Each colour that occurs counts once; by area, white paper would take most of the palette. The
    nearest colour is searched here, since Pillow's choice is only near: white paper gets a tint.
    """
    # one image at a time is unpacked: those of a long series would not fit into memory
    codes = (_rgb(png).astype(np.uint32) @ _PLACES for png in images)
    colours = np.unique(np.concatenate([np.unique(code) for code in codes]))
    seen = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=1).astype(np.uint8)
    entries = Image.fromarray(seen[None]).quantize(254, kmeans=4).getpalette() or []
    palette = [0, 0, 0, 255, 255, 255, *entries[: 3 * 254]]
    nearest = np.asarray(cKDTree(np.array(palette).reshape(-1, 3)).query(seen)[1], np.uint8)
    shown = []
    for png in images:
        number = np.searchsorted(colours, _rgb(png).astype(np.uint32) @ _PLACES)
        frame = Image.fromarray(nearest[number])
        frame.putpalette(palette)
        shown.append(frame)
    return shown


def _write_mp4(path: Path, images: Sequence[bytes], shown_s: Sequence[float]) -> None:
    """Writes H.264 at a constant rate, with repeated images."""
    from imageio_ffmpeg import write_frames

    opening = _even(_rgb(images[0]))
    rows, columns = opening.shape[:2]
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
            for png, each_s in zip(images, shown_s, strict=True):
                pixels = np.ascontiguousarray(_even(_rgb(png)))
                for _ in range(max(1, round(each_s * _FRAMES_PER_S))):
                    writer.send(pixels)


def _even(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image (H, W, 3) without the last of an odd number of rows or columns.

    Chroma of H.264 has half as many.
    """
    rows, columns = pixels.shape[:2]
    return pixels[: rows - rows % 2, : columns - columns % 2]
