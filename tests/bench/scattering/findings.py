"""Findings of the scattering study: sentences made from the numbers of its tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from tests.bench.scattering.estimators import Knows
from tests.bench.scattering.run import Error, Row, Study

_SEEN = 0.005  # of the pixels: smaller classes are omitted
HOLDS = 0.9  # of the pixels: two standard errors of noise contain 0.95


def findings(study: Study) -> tuple[str, ...]:
    """Sentences, the most general first, without those that do not apply to the scene."""
    return tuple(_sentences(study))


def _sentences(study: Study) -> Iterator[str]:
    def rows(*knows: Knows) -> list[Row]:
        return [row for row in study.rows if row.knows in knows and row.medium is not None]

    (plain,) = rows(Knows.NOTHING)
    yield _plain(plain, study)
    yield from _ranked(rows(Knows.RIG), plain)
    wrong = sorted(rows(Knows.RIG_WRONG), key=_rms)
    if wrong:
        each = _listed([f"{_named(row)} {_kelvin(_rms(row))}" for row in wrong])
        each = each.replace(" (wrong)", "")
        yield f"RMS errors with a wrong input: {each}."
    yield from _bounds(rows(Knows.RIG))
    yield _models(study, lambda row: row.medium, "The scattered share")
    yield from _classes(study, plain)
    if study.wet == 0.0:
        yield "Droplets emit less than the vapour in all pixels."
        return
    if study.wet < 1.0:
        yield _under_vapour(study, plain)
        yield from _alone(study)
    yield from _second(study, plain)


def _plain(row: Row, study: Study) -> str:
    error = _error(row)
    return (
        f"Plain DIT gives the emitting medium {abs(error.bias_K):.1f} K too "
        f"{'warm' if error.bias_K > 0 else 'cold'} (RMS {error.rms_K:.1f} K), with walls at "
        f"{study.scene.walls.temperature_K:g} K."
    )


def _ranked(rows: Sequence[Row], plain: Row) -> Iterator[str]:
    """Estimators without a model, best first, and those no better than plain DIT."""
    # A one-sided bound gives no temperature.
    ranked = sorted((row for row in rows if math.isfinite(row.width_K)), key=_rms)
    better = [row for row in ranked if _rms(row) < _rms(plain)]
    worse = [row for row in ranked if not _rms(row) < _rms(plain)]
    if better:
        said = _listed(
            [f"{_named(row)} {_kelvin(_rms(row))}, noise {row.noise_K:.1f} K" for row in better]
        )
        yield f"Smaller RMS errors without a model of the spray: {said}."
    if worse:
        said = _listed([f"{_named(row)} {_kelvin(_rms(row))}" for row in worse])
        yield f"No better than plain DIT without a model: {said}."


def _bounds(rows: Sequence[Row]) -> Iterator[str]:
    """Bounds of estimators with correct inputs."""
    held = [row for row in rows if _error(row).held >= HOLDS]
    broken = [row for row in rows if _error(row).held < HOLDS]
    if held:
        yield (
            f"The stated bounds contain the truth in {100 * HOLDS:.0f} % of the pixels or more for "
            f"{_listed([_named(row) for row in held])}."
        )
    if broken:
        said = _listed([f"{row.method} ({100 * _error(row).held:.0f} %)" for row in broken])
        yield f"They do not, as they contain noise only, for {said}."


def _models(study: Study, about: Callable[[Row], Error | None], what: str) -> str:
    """Right model, models with one wrong input, and the spread of all."""

    def errors(knows: Knows) -> list[tuple[Row, Error]]:
        every = ((row, about(row)) for row in study.rows if row.knows is knows)
        return [(row, error) for row, error in every if error is not None]

    (right,) = (error for _, error in errors(Knows.MODEL))
    ranked = sorted(errors(Knows.MODEL_WRONG), key=lambda pair: pair[1].rms_K)
    ((spread, bound),) = errors(Knows.MODELS)
    (low, least), (high, most) = ranked[0], ranked[-1]
    held = [error.held for _, error in ranked]
    return (
        f"{what} of the right model has an RMS error of {_kelvin(right.rms_K)}; of models with one "
        f"wrong input {_kelvin(least.rms_K)} ({_model(low)}) to {_kelvin(most.rms_K)} "
        f"({_model(high)}), whose own bounds contain the truth in {_percent(min(held))} to "
        f"{_percent(max(held))} of the pixels. The spread of all models contains it in "
        f"{_percent(bound.held)}, is {spread.width_K:.1f} K wide, and exists in "
        f"{_percent(spread.answered)} of them."
    )


def _classes(study: Study, plain: Row) -> Iterator[str]:
    """Errors by class of pixels."""
    wrong = [row for row in study.rows if row.knows is Knows.MODEL_WRONG and row.medium is not None]
    said = []
    for name, part in study.classes.items():
        left = [row.where[name] for row in wrong if math.isfinite(row.where[name])]
        if part >= _SEEN and left and math.isfinite(plain.where[name]):
            said.append(
                f"{name} ({_percent(part)} of the pixels) {plain.where[name]:.1f} K against "
                f"{min(left):.1f} to {max(left):.1f} K"
            )
    if said:
        yield f"RMS errors of plain DIT and of wrong models by class of pixels: {_listed(said)}."


def _under_vapour(study: Study, plain: Row) -> str:
    blind = [
        row.droplets.rms_K
        for row in study.rows
        if row.knows in (Knows.RIG, Knows.MODEL) and row.medium is not None
    ]
    off_K = plain.droplets.bias_K
    than = "colder" if off_K > 0 else "warmer"
    return (
        f"Droplets emit more than the vapour in {_percent(study.wet)} of the pixels. There they "
        f"are {abs(off_K):.1f} K {than} than T_app, and estimators that subtract the light of the "
        f"walls have RMS errors of {_kelvin(min(blind))} to {_kelvin(max(blind))}, as vapour emits "
        "too."
    )


def _alone(study: Study) -> Iterator[str]:
    """Droplet temperatures below vapour by models."""
    alone = [row for row in study.rows if row.medium is None and row.knows is not Knows.OTHER_BAND]
    if alone:
        one = Study(tuple(alone), {}, study.wet, study.classes, study.scene, study.second)
        what = "With the vapour of the model subtracted as well, the share"
        yield _models(one, lambda row: row.droplets, what)
        answered = [row.answered for row in alone if row.knows is Knows.MODEL_WRONG]
        yield (
            f"Wrong models give a droplet temperature in {_percent(min(answered))} to "
            f"{_percent(max(answered))} of the pixels."
        )


def _second(study: Study, plain: Row) -> Iterator[str]:
    """Results through the other filter."""
    rows = [row for row in study.rows if row.knows is Knows.OTHER_BAND]
    if not rows:
        return
    first, other = study.scene.optics, study.second.optics
    low, high = other.filter_um
    said = _listed([f"{_kelvin(row.droplets.rms_K)} ({_model(row)})" for row in rows])
    vapour = _share(other.vapour_m2_mol, first.vapour_m2_mol)
    yield (
        f"From {low:g} to {high:g} µm the vapour absorbs {vapour} and the liquid (k) "
        f"{_share(other.k, first.k)} of their values at {first.wavelength_um:g} µm. The RMS error "
        f"of the droplet temperature by the scattered share there is {said}, and "
        f"{_kelvin(plain.droplets.rms_K)} by T_app through the first filter."
    )


def _error(row: Row) -> Error:
    assert row.medium is not None
    return row.medium


def _rms(row: Row) -> float:
    return _error(row).rms_K


def _named(row: Row) -> str:
    return f"{row.method} ({row.needs})"


def _model(row: Row) -> str:
    return row.needs.removeprefix("model: ")


def _kelvin(value: float) -> str:
    return f"{value:.2f} K" if value < 1.0 else f"{value:.1f} K"


def _percent(part: float) -> str:
    return f"{100 * part:.0f} %"


def _share(value: float, of: float) -> str:
    return f"{value / of:.2g}" if of else "all"


def _listed(texts: Sequence[str]) -> str:
    return "; ".join(texts)
