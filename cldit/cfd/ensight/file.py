"""Files of an EnSight Gold case: the case file, and numbers in ascii or C binary.

Format after the EnSight user manual, "EnSight Gold Casefile Format". Files that end too early or
too late are refused.
"""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.cfd.inputs import regular, text_of
from cldit.cfd.mesh.cells import Labels, narrowed
from cldit.errors import SprayError


@dataclass(frozen=True)
class Item:
    """Entry of a .case file: its kind ("scalar per element") and name; times [s] and files.

    The time is None if it does not change.
    """

    kind: str
    name: str
    files: tuple[tuple[float | None, Path], ...]

    @property
    def times(self) -> list[float]:
        """Times at which it is written; none if it does not change."""
        return [time for time, _ in self.files if time is not None]


def read_case_file(path: Path) -> list[Item]:
    """Reads a .case file."""
    try:
        return _parsed(path, text_of(path).splitlines())
    except SprayError:
        raise
    except (ValueError, IndexError, OverflowError) as error:  # a number of 400 digits is infinite
        raise SprayError(f"{path}: is no EnSight case file ({error})") from error


def _parsed(path: Path, lines: list[str]) -> list[Item]:
    entries: list[tuple[str, str]] = []
    section, gold = "", False
    sets: dict[int, dict[str, list[float]]] = {}
    time_set: dict[str, list[float]] = {}
    key = ""
    for raw in lines:
        line = raw.split("#")[0].strip()
        if not line:
            continue
        if line in ("FORMAT", "GEOMETRY", "VARIABLE", "TIME", "FILE", "MATERIAL", "SCRIPTS"):
            section, key = line, ""
            continue
        label, colon, value = line.partition(":")
        if section == "FORMAT" and label.strip() == "type":
            gold = value.split() == ["ensight", "gold"]
        elif section in ("GEOMETRY", "VARIABLE") and colon:
            if not label.startswith("constant"):
                entries.append((label.strip(), value))
        elif section == "FILE":
            raise SprayError(f"{path}: keeps several times in one file (FILE section); not read")
        elif section == "TIME":
            if colon:
                key = label.strip()
                if key == "time set":
                    time_set = sets.setdefault(int(value.split()[0]), {})
                    continue
                if key.endswith(" file"):  # the numbers are in a file of their own
                    key = key.removesuffix(" file")
                    value = _numbers_file(path, value)
            numbers = value if colon else line  # values may begin on the next line
            time_set.setdefault(key, []).extend(float(word) for word in numbers.split())
    if not gold:
        raise SprayError(f"{path}: FORMAT: not `type: ensight gold`; export EnSight Gold, or .vtu")
    time_sets = {number: _time_set(path, content) for number, content in sets.items()}
    return [_item(path, kind, entry, time_sets) for kind, entry in entries]


def _numbers_file(path: Path, name: str) -> str:
    """Text of a file that the TIME section of `path` names."""
    words = shlex.split(name)
    if len(words) != 1:
        raise SprayError(f"{path}: TIME: {name.strip()!r}; allowed: one file")
    return text_of(path.parent / words[0])


def _item(path: Path, kind: str, entry: str, time_sets: dict[int, list[tuple[float, int]]]) -> Item:
    """Item of a line, `[time set] [file set] [name] pattern [options]`; variables have a name.

    time_sets: times [s] with their numbers in names of files.
    """
    words = shlex.split(entry)
    numbers: list[int] = []
    while words and words[0].isdigit():
        numbers.append(int(words.pop(0)))
    named = kind not in ("model", "measured")
    if len(words) < 1 + named or len(numbers) > 1:
        hint = "keeps several times in one file (a file set); not read" if words else "no file"
        raise SprayError(f"{path}: {kind}: {entry.strip()!r}: {hint}")
    name, pattern = words[0] if named else kind, words[-1] if named else words[0]
    if not numbers or "*" not in pattern:
        return Item(kind, name, ((None, path.parent / pattern),))
    if numbers[0] not in time_sets:
        raise SprayError(f"{path}: {name}: no time set {numbers[0]}")
    stars, steps = pattern.count("*"), time_sets[numbers[0]]
    files = [(time, re.sub(r"\*+", f"{number:0{stars}d}", pattern)) for time, number in steps]
    return Item(kind, name, tuple((time, path.parent / file) for time, file in files))


def _time_set(path: Path, content: dict[str, list[float]]) -> list[tuple[float, int]]:
    times = content.get("time values", [])
    count = int(content.get("number of steps", [len(times)])[0])
    if count != len(times) or not count:
        raise SprayError(f"{path}: TIME: {len(times)} time values for {count} steps")
    start = content.get("filename start number", [0])[0]
    step = int(content.get("filename increment", [1])[0])
    default = (int(start) + step * index for index in range(count))
    numbers = [int(number) for number in content.get("filename numbers", default)]
    if len(numbers) != count:
        raise SprayError(f"{path}: TIME: {len(numbers)} filename numbers for {count} steps")
    return list(zip(times, numbers, strict=True))


class Reader:
    """Words and numbers of one file, in order. Errors name the file."""

    def __init__(self, path: Path, *, binary: bool | None = None, order: str = "<") -> None:
        """Opens a file; a variable's `binary` and byte `order` are those of the geometry."""
        try:
            self.body = regular(path).read_bytes()
        except OSError as error:
            raise SprayError(f"{path}: cannot be read ({error})") from error
        self.path, self.at, self.order = path, 0, order
        head = self.body[:84]
        if b"Fortran Binary" in head:
            raise SprayError(f"{path}: is in Fortran binary; write it as C binary or ascii")
        self.binary = b"C Binary" in head if binary is None else binary
        self.lines: list[bytes] = []
        if not self.binary:
            if not self.body.endswith(b"\n"):
                raise self.fail("its last line has no end: the file is cut off")
            self.lines = self.body.splitlines()
        elif binary is None:
            self.at = 80

    def fail(self, problem: str) -> SprayError:
        """Error that names the file."""
        return SprayError(f"{self.path}: {problem}")

    @property
    def done(self) -> bool:
        """True at the end of the file."""
        return self.at >= len(self.body if self.binary else self.lines)

    def text(self, *, end: bool = False) -> str:
        """Next 80 characters, or the next line; "" at the end of the file if it may `end`."""
        if end and self.done:
            return ""
        if self.binary:
            self._skip(80)
        raw = self.body[self.at - 80 : self.at] if self.binary else self._line()
        return raw.split(b"\0")[0].decode("latin-1").strip()

    def integers(self, count: int, *, a_line: int = 1) -> Labels:
        """Next `count` integers (N,); in ascii `a_line` of them a line, in columns of ten."""
        if self.binary:
            return self._raw("i", count).astype(np.int32)
        with np.errstate(invalid="ignore"):
            return narrowed(self._numbers(count, 10, a_line))

    def floats(self, count: int, *, a_line: int = 1) -> NDArray[np.float32]:
        """Next `count` numbers (N,), float32; in ascii `a_line` a line, in columns of 12."""
        # NaN and infinity are for who knows what the number means
        with np.errstate(invalid="ignore", over="ignore"):
            if self.binary:
                return self._raw("f", count).astype(np.float32)
            return self._numbers(count, 12, a_line).astype(np.float32)

    def _raw(self, kind: str, count: int) -> NDArray[np.generic]:
        """Numbers of four bytes in the body itself."""
        begin = self.at
        self._skip(4 * count)
        return np.frombuffer(self.body, f"{self.order}{kind}4", count, begin)

    def particles(self, count: int) -> Floats:
        """Positions (N, 3) that follow the labels of measured particles."""
        if self.binary:
            self._skip(4 * count)
            return self.floats(3 * count).reshape(count, 3).astype(np.float64)
        rows = [self._line() for _ in range(count)]
        values = [self._split(row[8:], 12) for row in rows]
        if any(len(row) != 3 for row in values):
            raise self.fail("truncated or damaged: a particle without three coordinates")
        return np.array(values, dtype=np.float64).reshape(count, 3)

    def part_number(self) -> int:
        """Number of a part; one outside 1..65536 shows that the byte order is the other one."""
        number = int(self.integers(1)[0])
        if self.binary and not 0 < number <= 65536:
            self.order = ">" if self.order == "<" else "<"
            self.at -= 4
            number = int(self.integers(1)[0])
        return number

    def close(self) -> None:
        """Frees the content; values read from it stay valid."""
        self.body, self.lines = b"", []

    def _skip(self, count: int) -> None:
        remaining = len(self.body) - self.at
        if not 0 <= count <= remaining:
            raise self.fail(f"truncated or damaged: {count} bytes wanted, {remaining} are left")
        self.at += count

    def _line(self) -> bytes:
        if self.at >= len(self.lines):
            raise self.fail("truncated: more lines are announced")
        self.at += 1
        return self.lines[self.at - 1]

    def _numbers(self, count: int, width: int, a_line: int) -> Floats:
        need = -(-count // a_line)
        rows = self.lines[self.at : self.at + need]
        if count < 0 or len(rows) != need:
            raise self.fail(f"truncated: {need} lines wanted, {len(rows)} are left")
        self.at += need
        if a_line == 1:
            try:
                return np.array([float(row) for row in rows])
            except ValueError as error:
                raise self.fail(f"contains text that is no number ({error})") from error
        values = [value for row in rows for value in self._split(row, width)]
        if len(values) != count:
            raise self.fail(f"truncated or damaged: {len(values)} numbers where {count} should be")
        return np.array(values, dtype=np.float64)

    def _split(self, row: bytes, width: int) -> list[float]:
        """Numbers in columns, which may leave no space between them."""
        row = row.rstrip()
        parts = [row[i : i + width] for i in range(0, len(row), width)]
        try:
            return [float(part) for part in (parts if len(row) % width == 0 else row.split())]
        except ValueError as error:
            raise self.fail(f"contains text that is no number ({error})") from error
