"""Content of images by the names of their files: kind, black-body temperature, delay, number."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

Role = Literal["reference", "injection", "dark", "defective", ""]

_NUMBER = r"(?P<value>\d+(?:[.,p]\d+)?)"
_APART, _END = r"(?<![A-Za-z0-9.,])", r"(?![A-Za-z0-9])"
_TEMPERATURE = re.compile(
    rf"{_APART}(?:t|tbb|bb|bbt|temp|temperature|blackbody|black_body|bg|background"
    rf"|[a-z_]*(?:ref|reference|inj|injection|spray|shot)s?)?[ _=-]?"
    rf"{_NUMBER}[ _-]?(?P<unit>k|kelvin|c|°c|degc|celsius){_END}",
    re.IGNORECASE,
)
_BARE = re.compile(
    rf"{_APART}(?:T|(?i:tbb|bb|temp|temperature|blackbody|black_body))[ _=-]?{_NUMBER}{_END}"
)
_DELAY = re.compile(
    rf"{_APART}(?:delay|asoi|soi|t|d)?[ _+-]?{_NUMBER}[ _-]?(?P<unit>ms|us|µs){_END}", re.IGNORECASE
)
_SECONDS = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_WORDS: tuple[tuple[Role, str], ...] = (
    ("defective", r"(bad|dead|defect|defective|hot)_?(pix|pixel|pixels|px|map|mask)|bpm|defects"),
    ("dark", r"dark|darks|lid|cap|capped|closed|shutter"),
    (
        "reference",
        r"(no|without)_?(spray|inj|injection|fuel|shot)|spray_off|ref|refs|reference|references"
        r"|blank|blanks|empty|baseline|without|nospray|off",
    ),
    ("injection", r"spray|sprays|inj|injection|injections|shot|shots|fuel|jet|on"),
    ("reference", r"bg|bgs|background|backgrounds"),
)
# `bg_350K` and the folder `bg_2` are settings of the black body, `bg_007.tif` is a reference.
_BEHIND = re.compile(r"(?i)(?<![a-z])(?:bg|background)s?[ _=-]?\d+(?:[.,p]\d+)?(?!\d*\.[a-z]+$)")


@dataclass(frozen=True)
class Reported:
    """Content that a name reports; empty or None where it reports nothing.

    temperature: number with its unit, K, C or none.
    """

    role: Role = ""
    temperature: tuple[float, Literal["K", "C", ""]] | None = None
    delay_s: float | None = None


def reported(name: str, shared: Collection[str] = ()) -> Reported:
    """Reads a path relative to the folder of the measurement; parts near its end come first.

    shared: words that report no kind, as all names have them.
    """
    parts = re.split(r"[/\\]|::", name)[::-1]
    return Reported(
        _role(parts, shared),
        next((kelvin for part in parts if (kelvin := _temperature(part))), None),
        next((late_s for part in parts if (late_s := _delay(part)) is not None), None),
    )


def without_role(name: str) -> str:
    """A name without words for kinds of images: the same for references and their injections."""
    words = "|".join(pattern for _, pattern in _WORDS)
    return re.sub(rf"(?i)(?<![a-z])(?:{words})(?![a-z])", "", name).strip("/_- ")


def words_of(part: str) -> list[str]:
    """Words of a part of a path, in lower case."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", part)]


def _role(parts: list[str], shared: Collection[str]) -> Role:
    for part in parts:
        words = words_of(_BEHIND.sub("", part))
        joined = "_".join(word for word in words if word not in shared)
        for role, pattern in _WORDS:
            if re.search(rf"(?:^|_)(?:{pattern})(?:_|$)", joined):
                return role
    return ""


def _temperature(part: str) -> tuple[float, Literal["K", "C", ""]] | None:
    if match := _TEMPERATURE.search(part):
        return _value(match), "K" if match["unit"].lower().startswith("k") else "C"
    match = _BARE.search(part)
    return None if match is None else (_value(match), "")


def _delay(part: str) -> float | None:
    match = _DELAY.search(part)
    return None if match is None else _value(match) * _SECONDS[match["unit"].lower()]


def _value(match: re.Match[str]) -> float:
    return float(re.sub("[,p]", ".", match["value"]))
