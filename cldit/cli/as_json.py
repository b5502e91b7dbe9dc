"""Option `--json`: results of a command for scripts."""

import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec

import click
import numpy as np

from cldit.io.terminal import aside, tell

P = ParamSpec("P")


@dataclass(frozen=True)
class Outcome:
    """Result of a command (mappings, lists, numbers, texts), and its exit status."""

    data: Any
    code: int = 0


def json_option(command: Callable[P, Outcome]) -> Callable[..., None]:
    """Adds `--json` to a command that returns an `Outcome`, whose status becomes the program's.

    With `--json`, the standard output contains only one JSON text; the rest goes to the standard
    error.
    """

    @click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
    @wraps(command)
    def with_json(as_json: bool, *args: P.args, **kwargs: P.kwargs) -> None:
        if as_json:
            with aside():
                outcome = command(*args, **kwargs)
            tell(json.dumps(plain(outcome.data), indent=2, allow_nan=False))
        else:
            outcome = command(*args, **kwargs)
        if outcome.code:
            sys.exit(outcome.code)

    return with_json


def plain(value: Any) -> Any:
    """Value for JSON: paths and enums as texts, NaN and infinity as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(part) for part in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
