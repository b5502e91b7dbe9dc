"""Chi-square of measurements with faults of laboratories, by kind of fault.

python -m tests.bench faults --seeds 200 --only clean
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass

import numpy as np

from cldit.dit.recorded import evaluate_shots
from cldit.errors import EvaluationError
from tests.laboratory_faults import FAULTS

BANDS = ((0.03, 0.1), (0.1, 0.3), (0.3, 0.7), (0.7, 1.0))  # of emissivity


@dataclass(frozen=True, kw_only=True)
class FaultRow:
    """Seeds of one kind of fault.

    refused: number that ended by name. named: counts of the checks that stand out. kelvin,
    emissivity: chi-square of the total in each band; statistical_kelvin: of the statistical error.
    off_K, total_K: RMS error, and the stated one, in the second band.
    """

    refused: int
    named: Counter[str]
    kelvin: tuple[float, ...]
    emissivity: tuple[float, ...]
    statistical_kelvin: tuple[float, ...]
    statistical_emissivity: tuple[float, ...]
    off_K: float
    total_K: float
    messages: Counter[str]


def fault_row(name: str, seeds: range) -> FaultRow:
    """Evaluates the seeds of a kind of fault."""
    refused, named, messages = 0, Counter[str](), Counter[str]()
    squares: list[np.ndarray] = []
    for seed in seeds:
        made = FAULTS[name](seed)
        try:
            found = evaluate_shots(made.recorded)
        except EvaluationError as error:
            refused += 1
            messages[str(error).splitlines()[0][:160]] += 1
            continue
        named.update(one.name for one in found.witnesses if one.stands_out)
        named.update("ignored" for one in found.remarks if one.endswith("ignored"))
        assert found.budget is not None
        maps = found.maps
        kelvin = maps.apparent_temperature_K.astype(float)
        rows = []
        for low, high in BANDS:
            here = np.isfinite(kelvin) & (made.emissivity > low) & (made.emissivity <= high)
            off_K = (kelvin - made.kelvin)[here]
            off = (maps.emissivity - made.emissivity)[here]
            parts = (
                (off_K / found.budget.total_K[here]) ** 2,
                (off / found.budget.total_emissivity[here]) ** 2,
                (off_K / maps.apparent_temperature_standard_error_K[here]) ** 2,
                (off / maps.emissivity_standard_error[here]) ** 2,
                off_K**2,
                found.budget.total_K[here] ** 2,
            )
            rows.append([float(np.mean(one)) if here.any() else np.nan for one in parts])
        squares.append(np.array(rows))
    whole = np.nanmean(squares, axis=0) if squares else np.full((len(BANDS), 6), np.nan)
    return FaultRow(
        refused=refused,
        named=named,
        kelvin=tuple(whole[:, 0]),
        emissivity=tuple(whole[:, 1]),
        statistical_kelvin=tuple(whole[:, 2]),
        statistical_emissivity=tuple(whole[:, 3]),
        off_K=float(np.sqrt(whole[1, 4])),
        total_K=float(np.sqrt(whole[1, 5])),
        messages=messages,
    )


def main() -> None:
    """Prints a row for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", help="kinds whose name contains this")
    given = parser.parse_args()
    print("kind: refused; checks; T_app off, total / K; chi2 by emissivity of T, emissivity")
    for name in FAULTS:
        if given.only and given.only not in name:
            continue
        row = fault_row(name, range(given.seeds))
        chi2 = "; ".join(
            " ".join(f"{one:.2f}" for one in part)
            for part in (
                row.kelvin,
                row.emissivity,
                row.statistical_kelvin,
                row.statistical_emissivity,
            )
        )
        print(
            f"{name}: {row.refused}/{given.seeds}; {dict(row.named)}; {row.off_K:.2f} "
            f"{row.total_K:.2f}; {chi2}",
            *(f"\n    {count} x {text}" for text, count in row.messages.most_common(2)),
            flush=True,
        )
