"""What the tables say, in sentences made from their numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from cldit.study.scattering.estimators import Knows
from cldit.study.scattering.run import Error, Row, Study

_SEEN = 0.005  # of the pixels: less is not spoken of
HOLDS = 0.9  # of the pixels: two standard errors of noise alone hold in 0.95


def findings(study: Study) -> tuple[str, ...]:
    """Sentences, the plainest first; what the scene does not have is left out."""
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
        yield f"With an input that is wrong they leave: {each}."
    yield from _bounds(rows(Knows.RIG))
    yield _models(study, lambda row: row.medium, "The scattered share")
    yield from _classes(study, plain)
    if study.wet < 1.0:
        yield _under_vapour(study, plain)
        yield from _alone(study)
    yield from _second(study, plain)


def _plain(row: Row, study: Study) -> str:
    error = _error(row)
    return (
        f"Plain DIT shows what emits {abs(error.bias_K):.1f} K too "
        f"{'warm' if error.bias_K > 0 else 'cold'} (RMS {error.rms_K:.1f} K), with walls at "
        f"{study.scene.walls.temperature_K:g} K."
    )


def _ranked(rows: Sequence[Row], plain: Row) -> Iterator[str]:
    """Estimators without a model, best first, and which are no better than plain DIT."""
    # A bound that is open to one side gives no temperature of its own.
    ranked = sorted((row for row in rows if math.isfinite(row.width_K)), key=_rms)
    better = [row for row in ranked if _rms(row) < _rms(plain)]
    worse = [row for row in ranked if not _rms(row) < _rms(plain)]
    if better:
        said = _listed(
            [f"{_named(row)} {_kelvin(_rms(row))}, noise {row.noise_K:.1f} K" for row in better]
        )
        yield f"Without a model of the spray these leave less: {said}."
    if worse:
        said = _listed([f"{_named(row)} {_kelvin(_rms(row))}" for row in worse])
        yield f"No better than plain DIT without a model: {said}."


def _bounds(rows: Sequence[Row]) -> Iterator[str]:
    """Bounds of estimators whose inputs are right."""
    held = [row for row in rows if _error(row).held >= HOLDS]
    broken = [row for row in rows if _error(row).held < HOLDS]
    if held:
        yield (
            f"Their bounds hold in {100 * HOLDS:.0f} % of the pixels or more for "
            f"{_listed([_named(row) for row in held])}."
        )
    if broken:
        said = _listed([f"{_named(row)} ({100 * _error(row).held:.0f} %)" for row in broken])
        yield f"They do not, since they know of noise and nothing else, for {said}."


def _models(study: Study, about: Callable[[Row], Error | None], what: str) -> str:
    """Right, wrong in one thing, and the spread of all."""

    def errors(knows: Knows) -> list[tuple[Row, Error]]:
        every = ((row, about(row)) for row in study.rows if row.knows is knows)
        return [(row, error) for row, error in every if error is not None]

    (right,) = (error for _, error in errors(Knows.MODEL))
    ranked = sorted(errors(Knows.MODEL_WRONG), key=lambda pair: pair[1].rms_K)
    ((spread, bound),) = errors(Knows.MODELS)
    (low, least), (high, most) = ranked[0], ranked[-1]
    held = [error.held for _, error in ranked]
    return (
        f"{what} of the right model leaves {_kelvin(right.rms_K)}; of models that are wrong in one "
        f"thing {_kelvin(least.rms_K)} ({_model(low)}) to {_kelvin(most.rms_K)} ({_model(high)}), "
        f"and the bound of each alone holds in {_percent(min(held))} to {_percent(max(held))} of "
        f"the pixels. The spread of all holds in {_percent(bound.held)}, is {spread.width_K:.1f} K "
        f"wide, and says something in {_percent(spread.told)} of them."
    )


def _classes(study: Study, plain: Row) -> Iterator[str]:
    """Errors by what the pixels see."""
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
        yield f"Plain DIT's errors against those of wrong models, by what is seen: {_listed(said)}."


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
        f"are {abs(off_K):.1f} K {than} than T_app, and estimators that take off the walls' "
        f"light leave {_kelvin(min(blind))} to {_kelvin(max(blind))}: what emits is vapour too."
    )


def _alone(study: Study) -> Iterator[str]:
    """What models say of droplets below vapour."""
    alone = [row for row in study.rows if row.medium is None and row.knows is not Knows.OTHER_BAND]
    if alone:
        one = Study(tuple(alone), {}, study.wet, study.classes, study.scene, study.second)
        yield _models(
            one, lambda row: row.droplets, "With the model's vapour taken off too, the share"
        )
        told = [row.told for row in alone if row.knows is Knows.MODEL_WRONG]
        yield (
            f"Models that are wrong so give the droplets a temperature in {_percent(min(told))} to "
            f"{_percent(max(told))} of the pixels."
        )


def _second(study: Study, plain: Row) -> Iterator[str]:
    """Through the other filter."""
    rows = [row for row in study.rows if row.knows is Knows.OTHER_BAND]
    if not rows:
        return
    first, other = study.scene.optics, study.second.optics
    low, high = other.filter_um
    said = _listed([f"{_kelvin(row.droplets.rms_K)} ({_model(row)})" for row in rows])
    vapour = _share(other.vapour_m2_mol, first.vapour_m2_mol)
    yield (
        f"From {low:g} to {high:g} µm vapour absorbs {vapour} and liquid (k) "
        f"{_share(other.k, first.k)} of what they do at {first.wavelength_um:g} µm. The scattered "
        f"share there is off from the droplets by {said}, where T_app through the first filter is "
        f"{_kelvin(plain.droplets.rms_K)} off."
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
