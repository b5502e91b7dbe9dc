"""One state of a case: every cell and every parcel once, and a single time.

Judged by values and by relations between rows and files; names of columns only add to that.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cldit.arrays import Floats, Mask
from cldit.cfd.case import CfdCase, Cloud, Column, triple
from cldit.cfd.mesh.cells import AnyFloats, CellMesh, Labels
from cldit.cfd.mesh.elements import BoxMesh
from cldit.cfd.mesh.faces import JoinedMesh
from cldit.cfd.names import IDENTITY, TIME, is_mark, normalised
from cldit.cfd.plausible import only
from cldit.cfd.tolerances import ROUNDED, SLACK, WRITTEN
from cldit.errors import SprayError

_FEW = 20  # rows, or values of a column: fewer may look alike by chance
_SAMPLE = 20_000  # rows or cells that are looked at; bounds the time of a check


def _shown(value: object) -> str:
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def check_marks(columns: Mapping[str, Column]) -> None:
    """Refuses columns (N,), by name, of several times, or of a particle that occurs repeatedly."""
    for name, column in columns.items():
        plain = normalised(name)
        if column.values.ndim != 1 or not is_mark(name) or not len(column.values):
            continue
        marks, counts = np.unique(column.values, return_counts=True)
        if TIME.fullmatch(plain) and len(marks) > 1:
            shown = ", ".join(map(_shown, marks[:10])) + (", ..." if len(marks) > 10 else "")
            raise SprayError(
                f"{column.label}: has {len(marks)} values: {shown}; allowed: one time; keep the "
                "rows of one of these"
            )
        if IDENTITY.fullmatch(plain) and counts.max() > 1:
            often = int(np.argmax(counts))
            raise SprayError(
                f"{column.label}: {_shown(marks[often])} occurs {counts[often]} times, so the rows "
                "are tracks, or files put together twice; allowed: each particle once, at one time"
            )


def check_times(times_s: Mapping[Path, float]) -> None:
    """Refuses files of one state that state different times."""
    (oldest, begin), *later = sorted(times_s.items(), key=lambda pair: pair[1]) or [(Path(), 0.0)]
    for file, time in later:
        if abs(time - begin) > ROUNDED * max(abs(time), abs(begin)):
            raise SprayError(
                f"{oldest}: states the time {begin:.9g}, {file} the time {time:.9g}; allowed: gas "
                "and parcels of one time; keep the files of one time"
            )


def judged(
    accept: Sequence[str], checks: Mapping[str, Callable[[], str | None]]
) -> tuple[str, ...]:
    """Makes the `checks`, by name; an error of an accepted one becomes a remark.

    A check that cannot decide returns what it would need, which becomes a remark, too.
    """
    remarks: tuple[str, ...] = ()
    for name, check in checks.items():
        try:
            if (needed := check()) is not None:
                remarks += (f"Not checked ({name}): {needed}.",)
        except SprayError as error:
            if name not in accept:
                way = f"`--accept {name}` (spray.accept: [{name}]) reads it all the same"
                raise SprayError(f"{error}; if that is right, {way}") from error
            remarks += (f"Accepted ({name}): {error}.",)
    return remarks


def check_parcels(cloud: Cloud, accept: Sequence[str] = ()) -> tuple[str, ...]:
    """Refuses a cloud with parcels that occur repeatedly, or a row that sums up the others."""

    def tracks() -> str | None:
        check_marks(cloud.extra)
        return _check_tracks(cloud)

    checks = {"copies": partial(_check_copies, cloud), "summary": partial(_check_summary, cloud)}
    return judged(accept, checks | {"tracks": tracks})


def _check_copies(cloud: Cloud) -> None:
    """Refuses a cloud in which two parcels have equal place, size, and velocity and age if given.

    Parcels of age zero are ignored: several may leave one place.
    """
    columns = [cloud.position_m, *(cloud.fields[n] for n in ("d", "U", "age") if n in cloud.fields)]
    rows = np.column_stack([np.asarray(column.values, np.float64) for column in columns])
    rows = rows + 0.0  # a negative zero becomes zero
    at = np.arange(len(rows))
    if "age" in cloud.fields:
        at = np.flatnonzero(cloud.fields["age"].values > 0.0)
    original, same = _equal_rows(rows[at])
    if len(same):
        raise SprayError(
            f"{cloud.position_m.label}: {len(same)} of {len(rows)} parcels occur twice, such as "
            f"parcels {at[original[0]]} and {at[same[0]]} at {triple(rows[at[same[0]], :3])} m; "
            "allowed: each parcel once (export without the overlap of processors)"
        )


_LARGER = 5.0  # times the next largest size or mass of a parcel, and a fifth of all liquid


def _check_summary(cloud: Cloud) -> None:
    """Refuses a row with as many droplets as all others, or with far more liquid than each."""
    count, mass = cloud.fields["nParticle"].values, cloud.masses
    if len(mass) < _FEW:
        return
    row = int(np.argmax(count))
    total = bool(np.isclose(2.0 * count[row], count.sum(), rtol=WRITTEN))
    if not total:
        row = int(np.argmax(mass))
        second_mass = float(np.partition(mass, -2)[-2])
        size = cloud.fields["d"].values
        blob = 1.0 <= size[row] / np.delete(size, row).max() < _LARGER  # before its breakup
        if blob or mass[row] < max(mass.sum() / _LARGER, _LARGER * second_mass):
            return
    fault = "as many droplets as all others together" if total else "far more liquid than any other"
    raise SprayError(
        f"{cloud.fields['nParticle'].label}: row {row} ({count[row]:g} droplets, "
        f"{100 * mass[row] / mass.sum():.3g} % of the liquid) has {fault}, so it seems to be a "
        "summary of the others; allowed: one parcel a row; remove the row"
    )


_TIMES_IN = 10  # times of which other columns than identities tell
_MOST_PAIRS = 1.0 - 1.0 / _FEW  # that must have a property of one parcel at two times
_SPREAD = 3.0  # ages of one parcel differ by more than those of parcels injected together


def _check_tracks(cloud: Cloud) -> str | None:
    """Refuses rows that are the same parcels at several places of their way.

    Recognised by a column of whole numbers that occur equally often, or by one whose values recur
    in rows that lie behind each other on one way and have the droplets of one parcel.
    """
    for column, keys, is_int in _keys(cloud):
        values = column.values
        share = np.uint64(1 + len(values) // _SAMPLE)  # all rows of some values are enough
        rows = np.flatnonzero((keys.view(np.uint64) * _HASH[0] >> np.uint64(33)) % share == 0)
        _, group, counts = np.unique(keys[rows], return_inverse=True, return_counts=True)
        groups, often = len(counts), float(np.median(counts)) if len(counts) else 0.0
        equal = is_int and often == counts.min(initial=len(rows)) == counts.max(initial=0)
        recurring = int(counts[counts > 1].sum()) > len(rows) // (10 if is_int else 2)
        tracklike = 2 <= often <= _TIMES_IN
        if groups < _FEW or not recurring or not (is_int or tracklike):
            continue
        sample, alike = only(cloud, np.isin(np.arange(len(keys)), rows)), equal and often <= groups
        pair = _track_rows(sample, group, is_int=is_int, equal=alike)
        if pair is not None:
            a, b = rows[list(pair)]
            places = cloud.position_m.values
            raise SprayError(
                f"{column.label}: {groups} values in {len(rows)} rows, and rows of one value seem "
                f"to be one parcel at several times (tracks), such as rows {a} and {b}, of "
                f"{values[a]:.9g}, at {triple(places[a])} and {triple(places[b])} m; allowed: each "
                "parcel once; keep the rows of one time"
            )
    if cloud.extra or {"U", "age"} & set(cloud.fields):
        return None
    return f"{cloud.position_m.label}: needs velocities, ages, or a number of each parcel"


def _keys(cloud: Cloud) -> Iterator[tuple[Column, Floats, bool]]:
    """Columns of numbers, their values (N,), and whether these are whole; others also rounded.

    A number of droplets that comes from a mass has rounding errors.
    """
    fields = {name: cloud.fields[name] for name in ("nParticle", "d")}
    for name, column in {**cloud.extra, **fields}.items():
        if column.values.ndim != 1 or column.values.dtype.kind not in "fiu":
            continue
        values = np.asarray(column.values, np.float64)
        if np.isfinite(values).all():
            is_int = name not in fields and bool(np.all(values == np.rint(values)))
            yield column, values, is_int
            if not is_int:
                size = np.abs(np.where(values == 0.0, 1.0, values))
                step = WRITTEN * 10.0 ** np.floor(np.log10(size))
                yield column, np.rint(values / step) * step, is_int


def _track_rows(
    cloud: Cloud, group: Labels, *, is_int: bool, equal: bool
) -> tuple[int, int] | None:
    """Two rows of one parcel, if the rows of each `group` (N,) are one at several times.

    Neighbouring rows of a group, by their age or their way, have different ages. In `equal` groups
    they have as many droplets, or the second has smaller ones, or all parcels have the same; in
    others the second is farther along their velocity and has the droplets of the first, and ages in
    a group of values that are not integers (`is_int`) differ as much as those of all parcels.
    """

    def finite(name: str) -> AnyFloats | None:
        column = cloud.fields.get(name)
        return None if column is None or not np.isfinite(column.values).all() else column.values

    place, velocity, age = cloud.position_m.values, finite("U"), finite("age")
    count, size = cloud.fields["nParticle"].values, cloud.fields["d"].values
    along = place[:, 0] if velocity is None else place @ velocity.mean(axis=0)
    order = along if age is None else age
    rows = np.lexsort((order, group))
    same = np.flatnonzero(group[rows][1:] == group[rows][:-1])
    earlier, later = rows[same], rows[same + 1]
    if age is not None and not _mostly(age[later] > age[earlier]):
        return None
    varied = any(len(np.unique(values)) > len(values) // 20 for values in (count, size))
    alike = np.isclose(count[earlier], count[later], rtol=WRITTEN, atol=0.0)
    falls = size[later] <= 1.1 * size[earlier]
    if equal:
        ordered = age is not None or velocity is not None
        tracks = not varied or _mostly(alike) or (ordered and _mostly(falls))
    else:
        begin = np.flatnonzero(np.diff(group[rows], prepend=-1))
        span = np.maximum.reduceat(order[rows], begin) - np.minimum.reduceat(order[rows], begin)
        mixed = float(np.median(span)) * len(begin) > _SPREAD * float(np.ptp(order))
        tracks = velocity is not None and varied and (is_int or mixed) and _mostly(alike & falls)
        if tracks and velocity is not None:
            step, way = place[later] - place[earlier], velocity[earlier] + velocity[later]
            length = np.linalg.norm(step, axis=1) * np.linalg.norm(way, axis=1)
            straight = np.einsum("ij,ij->i", step, way) > 0.9 * length
            tracks = float(np.mean(straight)) > 0.5
    return (int(earlier[0]), int(later[0])) if tracks else None


def _mostly(pairs: Mask) -> bool:
    return float(np.mean(pairs)) > _MOST_PAIRS


def _equal_rows(rows: Floats) -> tuple[Labels, Labels]:
    """Pairs of equal rows (N, M): indices of the first, and of each further one.

    Rows are compared where hashes of them are equal: sorting numbers is much faster.
    """
    key = np.zeros(len(rows), np.uint64)
    for part in np.ascontiguousarray(rows).view(np.uint64).T:
        key = (key ^ part) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    order = np.argsort(key, kind="stable")
    at = np.flatnonzero(key[order][1:] == key[order][:-1])
    earlier, later = order[at], order[at + 1]
    equal = np.flatnonzero(np.all(rows[earlier] == rows[later], axis=1))
    equal = equal[np.argsort(later[equal])]
    return earlier[equal], later[equal]


def check_cells_once(case: CfdCase, cells: Labels, centre_m: Floats, volume_m3: Floats) -> None:
    """Refuses cells `cells` (N,) of centroids centre_m (N, 3) of which two fill one place."""
    if len(cells) < 2:
        return
    step = SLACK * max(float(np.cbrt(volume_m3.min())), 1e-12)
    # an irrational shift: centroids of regular grids do not lie between two places
    places = centre_m / step
    places += np.sqrt(0.5)
    original, same = _equal_rows(np.floor(places, out=places))
    if len(same):
        cover, covered = int(original[0]), int(same[0])
        fault = f"{len(same)} cells with fuel lie where"
        way = "export without ghost cells, or mark them by vtkGhostType"
    else:
        overlap = _covered(case, cells, centre_m, volume_m3)
        if overlap is None:
            return
        covered, cover, count = overlap
        fault = f"{count} cells with fuel are covered by others, where"
        way = "export only the finest cells of each place"
    rival, file = (_part_of(case.mesh, int(cells[index])) for index in (cover, covered))
    where = f"those of {rival}" if rival != file else "others of the same file"
    raise SprayError(
        f"{file}: {fault} {where} do, such as cells {cells[cover]} and {cells[covered]} of the "
        f"case at {triple(centre_m[covered])} m; allowed: each place in one cell ({way})"
    )


_FEWEST = 4  # covered cells; the centroid of a single dented cell may lie in its neighbour
_HASH = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def _covered(
    case: CfdCase, cells: Labels, centre_m: Floats, volume_m3: Floats
) -> tuple[int, int, int] | None:
    """Index of a cell that others cover, and of one of these, and the number of such cells.

    A box along the axes is covered if centroids of others, no larger, lie in it; another cell if
    smaller ones in the box of its volume have its volume and centroid, as refined ones do. Of many
    cells the largest and some of all are looked at.
    """
    count = len(cells)
    rows = np.arange(count)
    if count > _SAMPLE:
        largest = np.argpartition(volume_m3, -_SAMPLE // 2)[-_SAMPLE // 2 :]
        rows = np.union1d(largest, rows[:: 2 * count // _SAMPLE])
    cell = case.mesh.measure(cells[rows])
    edges = cell.upper_m - cell.lower_m
    filled = cell.volume_m3 / edges.prod(axis=1)
    exact = filled > 1.0 - SLACK
    if isinstance(case.mesh, BoxMesh):  # cubes of a volume may have had another shape
        exact &= np.ptp(edges, axis=1) > SLACK * edges.max(axis=1)
    middle = np.where(exact[:, None], (cell.lower_m + cell.upper_m) / 2, cell.centroid_m)
    half = edges * (np.cbrt(filled) * (1.0 - SLACK) / 2)[:, None]
    inside, moment, cover = np.zeros(len(rows)), np.zeros((len(rows), 3)), np.full(len(rows), -1)
    for box, point in _contained(middle, half, centre_m):
        smaller = volume_m3[point] <= np.where(exact[box], 1.01, 0.6) * cell.volume_m3[box]
        kept = smaller & (rows[box] != point)
        box, point = box[kept], point[kept]
        inside += np.bincount(box, volume_m3[point], len(rows))
        for axis in range(3):
            moment[:, axis] += np.bincount(box, volume_m3[point] * centre_m[point, axis], len(rows))
        cover[box] = point
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(moment / inside[:, None] - middle).max(axis=1) / (2.0 * half.max(axis=1))
    share = inside / cell.volume_m3
    bad = np.flatnonzero((exact & (share > 0.5)) | ((np.abs(share - 1.0) < 0.01) & (off < 0.02)))
    if len(bad) < min(_FEWEST, len(rows) // 10 + 1):
        return None
    return int(rows[bad[0]]), int(cover[bad[0]]), len(bad)


def _contained(middle: Floats, half: Floats, points: Floats) -> Iterator[tuple[Labels, Labels]]:
    """Indices of boxes, middle +- half (N, 3), and of points (P, 3) in them, some at a time."""
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    for begin in range(0, len(middle), 1_000):
        part = slice(begin, begin + 1_000)
        hits = tree.query_ball_point(middle[part], half[part].max(axis=1), p=np.inf)
        boxes = begin + np.repeat(np.arange(len(hits)), [len(hit) for hit in hits])
        members = np.concatenate([*hits, []]).astype(np.int64)
        within = np.all(np.abs(points[members] - middle[boxes]) < half[boxes], axis=1)
        yield boxes[within], members[within]


def hashes(places: Floats) -> NDArray[np.uint64]:
    """Hashes (N,) of whole numbers (..., 3)."""
    integers = places.reshape(-1, 3).astype(np.int64).view(np.uint64) * _HASH
    mixed = integers[:, 0] ^ (integers[:, 1] + integers[:, 2])
    return np.asarray((mixed ^ mixed >> np.uint64(29)) * _HASH[0])


def check_volume(mesh: CellMesh, volume_m3: float) -> None:
    """Refuses cells that are larger together than the box around all of them."""
    low, high = mesh.extent_m
    box_m3 = float(np.prod(high - low))
    if not isinstance(mesh, BoxMesh) and volume_m3 > (1.0 + SLACK) * box_m3:
        raise SprayError(
            f"{mesh.source}: the cells have {volume_m3:.4g} m3 together, the box around them "
            f"{box_m3:.4g} m3, so some overlap; allowed: each place in one cell (export without "
            "ghost cells and without coarse cells below finer ones)"
        )


def check_layers(mesh: CellMesh) -> None:
    """Refuses a mesh of one layer of cells, whose centroids lie in a plane: a run in 2D.

    A mesh with a thousandth of its cells off the plane passes once in 0.999^-20,000 = 5e8 times.
    """
    cells = np.unique(np.random.default_rng(1).integers(0, mesh.cells, _SAMPLE))
    if len(cells) < 8:
        return
    cell = mesh.measure(cells)
    middle = cell.centroid_m - cell.centroid_m.mean(axis=0)
    _, widths, axes = np.linalg.svd(middle, full_matrices=False)
    if widths[2] < WRITTEN * widths[0]:
        edge = float(np.min((cell.upper_m - cell.lower_m) @ np.abs(axes[2])))
        raise SprayError(
            f"{mesh.source}: its cells form one layer, {edge:.3g} m thick along {triple(axes[2])}: "
            "the case is flat, not a spray in space; run it in three dimensions, or as a wedge"
        )


def _part_of(mesh: CellMesh, cell: int) -> str:
    """Source of the part of a mesh to which a cell belongs."""
    if not isinstance(mesh, JoinedMesh):
        return mesh.source
    for part in mesh.parts:
        if cell < part.cells:
            return part.source
        cell -= part.cells
    return mesh.source
