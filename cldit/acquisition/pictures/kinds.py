"""Kinds of files with images: their endings, their first bytes, and their readers."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from cldit.errors import FileError
from cldit.io.files import open_regular

EXPORT = "export raw counts as TIFF of 16 bits"


@dataclass(frozen=True)
class Kind:
    """Kind of files.

    signatures: bytes at a position in the file. reader: `module:name` in this package; empty for
    files that are not read. way_out: advice for those. line: reader of numbers, one per image.
    """

    name: str
    endings: str
    signatures: tuple[tuple[int, bytes], ...] = ()
    reader: str = ""
    way_out: str = ""
    line: str = ""

    def load(self, name: str) -> Callable[..., Any]:
        """Imports the function `module:name` of this package."""
        module, _, function = name.partition(":")
        loaded: Callable[..., Any] = getattr(
            import_module(f"cldit.acquisition.pictures.{module}"), function
        )
        return loaded


_HDF5 = b"\x89HDF\r\n\x1a\n"
KINDS = (
    Kind(
        "TIFF",
        "tif tiff btf tf8",
        ((0, b"II*\0"), (0, b"MM\0*"), (0, b"II+\0"), (0, b"MM\0+")),
        "tiff:Tiff",
    ),
    Kind(
        "HDF5",
        "h5 hdf5 hdf nxs nx nexus nc nc4 mat",  # netCDF 4, and MATLAB 7.3 behind 512 bytes
        ((0, _HDF5), (512, _HDF5)),
        "hdf5:Hdf5",
        line="hdf5:read_line",
    ),
    Kind("netCDF 3", "", ((0, b"CDF\x01"), (0, b"CDF\x02")), "arrays:NetCdf3"),
    Kind("MATLAB 5", "", ((0, b"MATLAB 5.0 MAT-file"),), "arrays:Matlab5"),
    Kind("Zarr", "zarr", reader="arrays:Zarr", line="arrays:read_line"),
    Kind("Telops", "hcc", reader="hcc:Hcc"),
    Kind("NumPy", "npy", ((0, b"\x93NUMPY"),), "plain:open_npy"),
    Kind("PNG", "png", ((0, b"\x89PNG\r\n\x1a\n"),), "plain:open_png"),
    Kind("text", "csv txt asc tsv dat", reader="text:TextImages"),
    Kind(
        "a film of FLIR",
        "seq csq fff",
        ((0, b"FFF\0"),),
        way_out=f"{EXPORT} with FLIR Research Studio or ResearchIR, not temperatures",
    ),
    Kind(
        "a film of FLIR",
        "ats sfmov",
        way_out=f"{EXPORT}, or counts as CSV or MATLAB, with FLIR Research Studio or ResearchIR; "
        "FLIR's Science File SDK converts many files",
    ),
    Kind("a film of Cedip and FLIR", "ptw", way_out=f"{EXPORT} with Altair or ResearchIR"),
    Kind("a film of InfraTec", "irb", ((0, b"\xffIRB\0"),), way_out=f"{EXPORT} with IRBIS"),
    Kind("a film of Optris", "ravi", way_out=f"{EXPORT} with PIX Connect"),
    Kind(
        "JPEG, which loses what it compresses", "jpg jpeg", ((0, b"\xff\xd8\xff"),), way_out=EXPORT
    ),
    Kind("FITS", "fits fit fts", ((0, b"SIMPLE  ="),), way_out=EXPORT),
    Kind("TDMS of LabVIEW", "tdms", ((0, b"TDSm"),), way_out=f"{EXPORT}, tables of it as CSV"),
    Kind("a film of a display", "avi mp4 mov", ((4, b"ftyp"),), way_out=EXPORT),
)
_HEAD = max(at + len(sign) for kind in KINDS for at, sign in kind.signatures)
ALLOWED = ", ".join(
    f".{ending}" for kind in KINDS if kind.reader for ending in kind.endings.split()
)


@cache
def by_ending(ending: str) -> Kind | None:
    """Kind of files with an ending, without its point."""
    return next((kind for kind in KINDS if ending in kind.endings.split()), None)


def kind_of(path: Path) -> Kind | None:
    """Kind of a file by its first bytes, otherwise by its ending; None for an unknown one."""
    if any((path / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup")):
        return by_ending("zarr")
    try:
        with open_regular(path) as stream:
            head = stream.read(_HEAD)
    except FileError:  # its reader reports it
        head = b""
    for kind in KINDS:
        if any(head[at : at + len(signature)] == signature for at, signature in kind.signatures):
            return kind
    return by_ending(path.suffix.lower().removeprefix("."))
