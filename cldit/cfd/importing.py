"""Import of a case: list it, check it, describe the result, store it."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import ValidationError

from cldit.cfd.formats import contents, find_format
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent
from cldit.scene.checks import describe
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Spray
from cldit.spray.spray_file import write_spray

# name in the notes: text, unit shown, factor
_SHOWN = {
    "time_s": ("time", "ms", 1e3),
    "parcels": ("parcels", "", 1.0),
    "droplets": ("droplets", "", 1.0),
    "liquid_mass_kg": ("liquid mass", "mg", 1e6),
    "vapour_mass_kg": ("vapour mass", "mg", 1e6),
    "sauter_mean_diameter_m": ("Sauter mean diameter", "um", 1e6),
    "liquid_penetration_90_m": ("liquid penetration (90 % of mass)", "mm", 1e3),
    "liquid_penetration_95_m": ("liquid penetration (95 % of mass)", "mm", 1e3),
    "liquid_penetration_99_m": ("liquid penetration (99 % of mass)", "mm", 1e3),
    "liquid_path_m": ("penetration in OpenFOAM's log", "mm", 1e3),
    "vapour_penetration_m": ("vapour penetration (0.1 % fuel)", "mm", 1e3),
    "vapour_mass_fraction_max": ("largest mass fraction of fuel", "", 1.0),
    "gas_temperature_min_K": ("gas, coldest cell", "K", 1.0),
    "gas_temperature_max_K": ("gas, hottest cell", "K", 1.0),
    "wall_temperature_K": ("walls of the case", "K", 1.0),
    "ambient_temperature_K": ("gas outside the jet, median", "K", 1.0),
    "gas_cells": ("cells", "", 1.0),
    "vapour_cells": ("cells with vapour", "", 1.0),
    "parcels_left_out": ("parcels omitted", "", 1.0),
    "copies": ("copies that make it whole", "", 1.0),
}
_COUNTS = ("parcels", "gas_cells", "vapour_cells", "parcels_left_out", "copies")


def cfd_spray(keys: Mapping[str, object]) -> CfdSpray:
    """Makes the `spray` section of a scene from the keys that are not None.

    Args:
        keys: values by key, as in YAML; None: not given.

    Returns:
        The section `spray` of a scene.

    Raises:
        SprayError: a key or value is not allowed.
    """
    try:
        return CfdSpray.model_validate({key: v for key, v in keys.items() if v is not None})
    except ValidationError as error:
        raise SprayError(describe(CfdSpray, error.errors())) from error


def import_case(
    file: str | Path, out: str | Path | None = None, *, watch: Watch = silent, **keys: object
) -> Spray:
    """Checks a CFD result and reads its spray, as `cldit import`.

    Args:
        file: case, folder or file of any format that `cldit import` reads.
        out: file of cldit, .npz, to keep the spray in; None writes none.
        watch: receives the progress.
        keys: of the section `spray` of a scene with `model: cfd`, such as time_s, cloud, nozzle_m,
            axis, sector, symmetry, mapping, accept.

    Returns:
        The spray; its `notes` are figures of it, its `remarks` what was chosen.

    Raises:
        SprayError: a key is not allowed, or the case is refused.
    """
    spec = cfd_spray({"file": Path(file), **keys})
    return imported(spec, None if out is None else Path(out), watch=watch)


def list_case(spec: CfdSpray) -> list[str]:
    """Lists format, times, cell fields and clouds, a line each.

    Args:
        spec: the case.

    Returns:
        Lines of text.

    Raises:
        SprayError: the case cannot be read.
    """

    def listed(names: Iterable[str]) -> str:
        return ", ".join(f'"{name}"' if "," in name else name for name in names)

    case = contents(spec)
    times = ", ".join(f"{time:.9g}" for time in case.times_s) or "not stated"
    fields = listed(case.fields) or "none"
    lines = [f"format: {case.format}", f"times in s: {times}", f"cell fields: {fields}"]
    clouds = [f"cloud {key}: {listed(names) or 'no fields'}" for key, names in case.clouds.items()]
    return lines + (clouds or ["clouds: none"])


def imported(spec: CfdSpray, out: Path | None, *, watch: Watch = silent) -> Spray:
    """Reads the spray of a case; writes cldit's own file of it if `out` is a path.

    Args:
        spec: the case.
        out: path of the file, which appears whole or not at all; None writes none.
        watch: receives the progress.

    Returns:
        The spray in cldit's frame.

    Raises:
        SprayError: the case or the file is refused, see `read_cfd`; no file is written then.
    """
    spray = read_cfd(spec, watch=watch)
    if out is not None:
        write_spray(out, spray, watch=watch)
    return spray


def case_lines(spec: CfdSpray, spray: Spray, *, files: bool = False) -> list[str]:
    """Describes the `spray` that was read from the case `spec`, a line each, with its files too."""
    size = sum(file.bytes for file in spray.files)
    read = f"{len(spray.files)} files read, {size / 1e6:.3g} MB"
    lines = [f"{spec.file}: {find_format(spec)}, {read}"]
    lines += [f"  {file.text}" for file in spray.files if files]
    for name, (label, unit, factor) in _SHOWN.items():
        if name in spray.notes:
            if name == "time_s" and abs(spray.notes[name]) >= 1.0:  # degrees of crank angle
                label, unit, factor = "time, in the case's own unit", "", 1.0
            value = spray.notes[name] * factor
            shown = f"{value:.0f}" if name in _COUNTS else f"{value:.5g}"
            lines.append(f"  {label:34s}{shown:>12s} {unit}".rstrip())
    return lines + [f"  {remark}" for remark in spray.remarks]
