"""Measurements of this checkout: `python -m tests.bench` lists them, `... NAME` runs one."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from pathlib import Path

MEASUREMENTS = (
    "ablation",
    "budget_reference",
    "calibration",
    "device_reference",
    "devices",
    "droplets",
    "error",
    "evaluation",
    "faults",
    "fit_liquid",
    "fit_bias",
    "gallery",
    "imports",
    "licences",
    "mutations",
    "models_small",
    "named_changes",
    "proof",
    "scene_reference",
    "sprays",
    "stability",
)


def described(name: str) -> str:
    """First line of the docstring of a measurement, which is not imported."""
    source = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


def main() -> None:
    """Runs the measurement that the command line names."""
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        for name in MEASUREMENTS:
            print(f"{name:18}{described(name)}")
        return
    name = sys.argv[1]
    if name not in MEASUREMENTS:
        sys.exit(f"no measurement {name}; allowed: {', '.join(MEASUREMENTS)}")
    sys.argv[:2] = [f"python -m tests.bench {name}"]
    import_module(f"tests.bench.{name}").main()


if __name__ == "__main__":
    main()
