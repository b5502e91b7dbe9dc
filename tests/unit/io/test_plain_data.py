"""YAML and JSON: what nobody means is refused with its line, before it costs memory or time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import cldit
from cldit.acquisition.measured import open_measured
from cldit.acquisition.plan import load_plan
from cldit.errors import OpticsError, RunFolderError, SceneError
from cldit.io.plain_data import dump_yaml, parse_json, parse_yaml, read_json, read_mapping
from cldit.optics.liquid_table import read_liquid_table
from cldit.rig.load import read_rig
from cldit.scene import load_scene

# Each value holds the one before nine times: 9^8 in all.
_LAUGHS = "a0: &a0 1\n" + "\n".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 9)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3, column 1: duplicate key 'a', first in line 1"),
        ("1: a\n0x1: b\n", "line 2, column 1: duplicate key '0x1'"),
        ("a: &a [*a]", "contains itself"),
        ("a: *b", "undefined alias"),
        (_LAUGHS, "aliases repeat more than"),
        ("a: " + "[" * 101 + "]" * 101, "deeper than 100"),
        ("a: " + "{a: " * 100_000, "deeper|nesting"),
        ("a: !!python/object:os.system {}", r"line 1, column 4: the tag .* is not allowed"),
        (f"a: {'9' * 5000}", r"999\.\.\. is no int"),
        ("a: 0400", "0400 is octal in YAML"),
        ("a: 1:30", "1:30 is a sexagesimal number"),
        ('a: "x\\0y"', "line 1, column 4: a text contains a NUL byte"),
        ("a: \x00", "control characters are not allowed"),
        ("a: 1\n--- \nb: 2\n", "but found another document"),
        ("? [1]\n: 2", "unhashable key"),
    ],
)
def test_refused(text: str, message: str) -> None:
    with pytest.raises(SceneError, match=rf"^file: is not valid YAML \(.*({message})"):
        parse_yaml(text, source="file")


def test_taken_as_meant() -> None:
    """Dates are text; aliases and merged keys of a reasonable size stay."""
    text = "day: 2024-13-45\nbase: &b {a: 1, c: 2}\nown: {<<: *b, a: 3}\nn: [0, 0.5, 1.0e+3, 0x10]"
    data = parse_yaml(text, source="file")
    assert data == {
        "day": "2024-13-45",
        "base": {"a": 1, "c": 2},
        "own": {"a": 3, "c": 2},
        "n": [0, 0.5, 1000.0, 16],
    }
    assert parse_yaml(dump_yaml({**data, "µ": "0400"}), source="file") == {**data, "µ": "0400"}


def test_whoever_reads_names_the_file(tmp_path: Path) -> None:
    """One loader: each reader of YAML refuses the same, in its own class of errors."""
    path = tmp_path / "two.yaml"
    path.write_text("name: a\nname: b\n")
    for read in (load_scene, load_plan, read_rig, open_measured):
        with pytest.raises(SceneError, match=r"two\.yaml: is not valid YAML \(line 2"):
            read(path)
    with pytest.raises(OpticsError, match=r"two\.yaml: is not valid YAML \(line 2"):
        read_liquid_table(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    for read in (load_scene, load_plan, read_rig, open_measured, read_mapping):
        with pytest.raises(SceneError, match=r"pipe\.yaml: cannot be read \(is a pipe"):
            read(tmp_path / "pipe.yaml")
    with pytest.raises(SceneError, match="is a device"):
        read_mapping(Path("/dev/zero"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfea\x00", "line 1: byte 0xff is not UTF-8"),
        (b"a: 1\nb: \xe9\n", "line 2: byte 0xe9 is not UTF-8"),
        (b"", "contains NoneType, expected keys and values"),
    ],
)
def test_encodings_and_contents(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=message):
        read_mapping(path)
    path.write_bytes(b"\xef\xbb\xbfa: 1\n")  # with a byte order mark, as Windows writes it
    assert read_mapping(path) == {"a": 1}


def test_a_nul_byte_in_a_path() -> None:
    with pytest.raises(SceneError, match="contains a NUL byte"):
        cldit.load_scene("a\0b.yaml")


def test_too_large(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    with path.open("wb") as stream:
        stream.truncate(200_000_000)  # takes no room on the disk
    with pytest.raises(SceneError, match="more than 64 MB"):
        read_mapping(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "a": 2}', "duplicate key 'a'"),
        ("[" * 100_000, "too deep"),
        ("{", "Expecting property name"),
        ("", "Expecting value"),
    ],
)
def test_json(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(RunFolderError, match=rf"a\.json: is damaged \(.*{message}"):
        read_json(path)
    assert parse_json('{"a": [1, {"b": null}]}') == {"a": [1, {"b": None}]}
