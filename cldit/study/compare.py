"""A reference and its variants: what most of the paper's studies are."""

from __future__ import annotations

from collections.abc import Mapping

from cldit.run import Run
from cldit.show.report.html import Picture
from cldit.study.measures import Change, Mask, Phases, mean_K, root, tips
from cldit.study.page import Row
from cldit.study.pictures import Crop, changes_figure, frame_of, maps_figure


def change_rows(reference: Run, cases: Mapping[str, Run]) -> list[Row]:
    """T_app of every one of `cases` minus that of `reference`, as a row for a table.

    Everywhere, below the nozzle, at the tips, where droplets and vapour are seen together, and
    where vapour alone is.
    """
    places: dict[str, Mask | None] = {
        "all": None,
        "below the nozzle": root(reference),
        "tips": tips(reference),
        "both phases": Phases.of(reference).both,
        "vapour only": Phases.of(reference).vapour_only,
    }
    rows: list[Row] = []
    for name, case in cases.items():
        change = Change.of(case, reference)
        row: dict[str, float | str] = {"case": name, "RMS / K": change.rms()}
        row["99th percentile / K"] = change.largest()
        row |= {f"mean, {place} / K": change.mean(mask) for place, mask in places.items()}
        rows.append(row)
    return rows


def mean_change(case: Run, reference: Run, where: Mask) -> float:
    """Mean change of T_app [K] from `reference` to `case` over the pixels `where` (H, W).

    Args:
        case, reference: runs of the same camera.
        where: (H, W) True for pixels that count.
    """
    return Change.of(case, reference).mean(where)


def change_pictures(
    reference: Run,
    cases: Mapping[str, Run],
    *,
    reference_name: str,
    about: str,
    limit_K: float,
    crop: Crop | None = None,
) -> dict[str, Picture]:
    """The reference's map with those of the cases, and the differences.

    Args:
        reference: run to compare with.
        cases: runs by name.
        reference_name: name of the reference.
        about: ends the captions.
        limit_K: end of the scale.
        crop: part of the picture.

    Returns:
        Two pictures.
    """
    images = {name: Change.of(case, reference).image for name, case in cases.items()}
    return {
        "changes": Picture(
            changes_figure(
                images,
                frame_of(reference),
                title=f"T_app minus that of {reference_name}",
                limit_K=limit_K,
                crop=crop,
            ),
            f"Difference of apparent temperature to {reference_name}, {about}.",
        ),
        "maps": Picture(
            maps_figure(
                {reference_name: reference, **cases}, title="apparent temperature", crop=crop
            ),
            f"The maps themselves, {about}.",
        ),
    }


def root_change_K(case: Run, reference: Run) -> float:
    """Change of the mean T_app below the nozzle from `reference` to `case`.

    For sprays whose droplets lie in different places.
    """
    return mean_K(case, root(case)) - mean_K(reference, root(reference))


def tips_change_K(case: Run, reference: Run) -> float:
    """Change of the mean T_app at the tips, each spray's own, from `reference` to `case`."""
    return mean_K(case, tips(case)) - mean_K(reference, tips(reference))
