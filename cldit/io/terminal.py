"""Output to the terminal: in any locale, into closed pipes and full disks."""

import codecs
import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any, TextIO

_PLAIN = {"µ": "u", "μ": "u", "×": "x", "·": "*", "°": " deg ", "→": "->", "±": "+-", "≤": "<=",
          "≥": ">=", "–": "-", "—": "-", "λ": "lambda", "ε": "eps", "τ": "tau"}  # fmt: skip
_ERRORS = "cldit-plain"


def _plain(error: UnicodeError) -> tuple[str | bytes, int]:
    """ASCII for characters that the terminal's encoding lacks; bytes of file names unchanged."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    end = error.start + 1
    if 0xDC80 <= ord(letter) <= 0xDCFF:  # a byte of a name that is not UTF-8
        return bytes([ord(letter) - 0xDC00]), end
    simple = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return _PLAIN.get(letter, simple or "?"), end


codecs.register_error(_ERRORS, _plain)


def prepare_streams() -> None:
    """Makes standard streams that accept any text; a program calls it first.

    A closed stream becomes the null device: otherwise the next opened file would get its
    descriptor, and output of libraries would go into that file.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free descriptor
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is not None and stream is getattr(sys, f"__{name}__"):
            setattr(sys, name, _remembering(stream))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=_ERRORS)


class _Remembering(io.FileIO):
    """Standard stream that remembers a failed write: the error itself names no file."""

    problem: OSError | None = None

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            self.problem = error
            raise


def _remembering(stream: TextIO) -> TextIO:
    raw = _Remembering(stream.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=_ERRORS,
        line_buffering=stream.isatty(),
        write_through=stream is sys.__stderr__,
    )


def cannot_take(stream: TextIO | None) -> OSError | None:
    """Error of a failed write to a stream; None if there was none."""
    try:
        if stream is not None:
            stream.flush()
    except OSError as error:
        return error
    raw = getattr(getattr(stream, "buffer", None), "raw", None)
    return raw.problem if isinstance(raw, _Remembering) else None


def silence(stream: TextIO) -> None:
    """Drops buffered output of a stream, so that the end of Python does not fail."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def tell(line: str, *, end: str = "\n") -> None:
    """Writes a text unchanged, and `end`, to the standard output at once."""
    if sys.stdout is not None:
        sys.stdout.write(f"{line}{end}")
        sys.stdout.flush()


@contextmanager
def aside() -> Iterator[None]:
    """Redirects printed text to the standard error, so that the output has only data."""
    with redirect_stdout(sys.stderr):
        yield


def warn(line: str) -> None:
    """Writes a line to the standard error at once; a failure is ignored."""
    try:
        if sys.stderr is not None:
            sys.stderr.write(f"{line}\n")
            sys.stderr.flush()
    except (OSError, ValueError):
        silence(sys.stderr)
