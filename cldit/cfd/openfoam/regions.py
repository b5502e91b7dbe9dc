"""Regions and times of a case, and the choice among them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from cldit.cfd.case import NO_CLOUD, choose_time, only_claimant
from cldit.cfd.openfoam.file import TIME, Root, find_foam, split_roots
from cldit.errors import NotAtThisTime, SprayError
from cldit.scene.spray import CfdSpray

_DEFAULT = "region0"  # OpenFOAM's own name of the mesh in constant/polyMesh


@dataclass(frozen=True)
class Step:
    """One time of one region.

    region: "" for the mesh of the case itself; roots: the case, or its processors; folder: of the
    fields, below each root.
    """

    case: Path
    region: str
    roots: tuple[Root, ...]
    time: float
    folder: str
    remarks: tuple[str, ...]

    @property
    def place(self) -> Path:
        """Folder of the fields of the first root."""
        return self.roots[0].path / self.folder


def case_folder(path: Path) -> Path:
    """Folder of a case, or of the `.foam` file in it."""
    case = path if path.is_dir() else path.parent
    if not case.is_dir():
        raise SprayError(f"{path}: no such case (spray.file)")
    return case


def is_openfoam(path: Path) -> bool:
    """True for a case folder or the `.foam` file in one."""
    if path.suffix in (".foam", ".OpenFOAM"):
        return True
    return path.is_dir() and bool(regions(path))


def regions(case: Path) -> list[str]:
    """Regions that have a mesh; "" is that of the case itself."""
    places = [f"{root}constant/{inner}" for root in ("", "processor0/", "processors*/")
              for inner in ("polyMesh", "*/polyMesh")]  # fmt: skip
    folders = {folder.parent for place in places for folder in case.glob(place) if folder.is_dir()}
    names = {folder.name for folder in folders if folder.name != "polyMesh"}
    return sorted("" if name == "constant" else name for name in names)


def time_folders(root: Path) -> dict[float, list[Path]]:
    """Folders named by a number, by that number."""
    by_time: dict[float, list[Path]] = {}
    for folder in sorted(root.iterdir()):
        if TIME.match(folder.name) and folder.is_dir():
            by_time.setdefault(float(folder.name), []).append(folder)
    return by_time


def find_step(spec: CfdSpray) -> Step:
    """Region and time asked for, else the only region (or that with the fuel) and the last time.

    A decomposed case is read processor by processor if its own folder does not have the time.
    """
    case = case_folder(spec.file)
    available = regions(case)
    if not available:
        places = "neither constant/polyMesh nor constant/REGION/polyMesh, nor those of processors"
        raise SprayError(f"{case}: no mesh: {places}")
    processors = split_roots(case)
    chosen, remarks = _region(case, available, processors, spec)
    reconstructed = _times(case, chosen)
    split = _times(processors[0].path, chosen) if processors else {}
    try:
        time_s = choose_time(str(case), [*reconstructed, *split], spec.time_s)
    except SprayError as error:
        hint = f"; its VTK output can be read as {case / 'VTK'}" if (case / "VTK").is_dir() else ""
        raise SprayError(f"{error}{hint}") from error
    if time_s in reconstructed and time_s in split:
        ours, theirs = reconstructed[time_s][0] / chosen, split[time_s][0] / chosen
        if _newest(theirs) > _newest(ours):
            only_claimant(f"time {time_s:g}, the processors' being newer", (ours, theirs))
        remarks = (*remarks, f"Time {time_s:g} was read from {ours}, not from the processors.")
    roots = (Root(case),) if time_s in reconstructed else tuple(processors)
    folders = reconstructed[time_s] if time_s in reconstructed else split[time_s]
    time = only_claimant(f"time {time_s:g}", folders).name
    return Step(case, chosen, roots, time_s, str(Path(time) / chosen), remarks)


def _times(root: Path, region: str) -> dict[float, list[Path]]:
    """Times with results: folders that have a field in addition to the mesh."""
    filled = {}
    for time, folders in time_folders(root).items():
        # a starting time may lack temperature and fuel
        stored = [path for path in folders if any(map(Path.is_file, (path / region).glob("*")))]
        if stored:
            filled[time] = stored
    return filled


def _newest(folder: Path) -> float:
    return max((file.stat().st_mtime for file in folder.iterdir() if file.is_file()), default=0.0)


def _region(
    case: Path, available: Sequence[str], processors: Sequence[Root], spec: CfdSpray
) -> tuple[str, tuple[str, ...]]:
    """Region asked for, else the only one, or the only one with the fuel; and a remark."""

    def names(selected: Iterable[str]) -> str:
        return ", ".join(region or _DEFAULT for region in selected)

    if spec.region is not None:
        plain = "" if spec.region == _DEFAULT else spec.region
        if plain not in available:
            raise SprayError(
                f"{case}: no region {spec.region!r} (spray.region); available: {names(available)}"
            )
        return plain, ()
    if len(available) == 1:
        return available[0], (f"Region {available[0]}, the only one.",) if available[0] else ()
    roots = [case, *(root.path for root in processors[:1])]
    times = [path for root in roots for folders in time_folders(root).values() for path in folders]
    fuel = spec.fuel_field
    fuelled = [name for name in available if any(find_foam(time / name / fuel) for time in times)]
    if len(fuelled) != 1:
        problem = f"{len(fuelled)} of its regions have the field {spec.fuel_field!r}"
        raise SprayError(f"{case}: {problem}; set spray.region to one of {names(available)}")
    unread = names(region for region in available if region != fuelled[0])
    chosen = fuelled[0] or _DEFAULT
    return fuelled[0], (f"Region {chosen} has {spec.fuel_field}; not read: {unread}.",)


def clouds_of(case: Path) -> list[Path]:
    """Folders of the clouds at any time of a case, of its regions and processors."""
    roots = [case, *sorted(case.glob("processor*"))]
    times = [path for root in roots for folders in time_folders(root).values() for path in folders]
    patterns = ("lagrangian/*", "*/lagrangian/*")
    paths = [path for time in times for pattern in patterns for path in sorted(time.glob(pattern))]
    return [path for path in paths if path.is_dir()]


def refuse_missing_parcels(step: Step) -> None:
    """Refuses a time without parcels if there are some elsewhere, or in a layout not read."""
    for root in step.roots:
        if elsewhere := _unread_parcels(root.path / step.folder):
            raise SprayError(
                f"{elsewhere[0].parent}: parcels of OpenFOAM 13's Lagrangian library are not "
                "read; export them with foamToVTK and give its folder, or set "
                f"spray.cloud: {NO_CLOUD} for gas alone"
            )
    homes = {cloud.parent.parent for cloud in clouds_of(step.case)}
    if step.region:
        homes = {home.parent for home in homes if home.name == step.region}
    if times := {home.name for home in homes if TIME.match(home.name)}:
        shown = ", ".join(sorted(times, key=float)[:5]) + (", ..." if len(times) > 5 else "")
        hint = f"but at others: {shown} (spray.cloud: {NO_CLOUD} for gas alone)"
        raise NotAtThisTime(f"{step.place}: no parcels at this time, {hint}")


def _unread_parcels(folder: Path) -> list[Path]:
    """Files of parcels of OpenFOAM 13's Lagrangian library below the folder of a time."""
    return [
        file
        for file in sorted(folder.glob("*/*")) + sorted(folder.glob("*/*/*"))
        if file.name.removesuffix(".gz") in ("positions", "coordinates", "position")
        and file.relative_to(folder).parts[0] not in ("lagrangian", "polyMesh", "uniform")
    ]
