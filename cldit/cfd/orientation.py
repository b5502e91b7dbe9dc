"""Nozzle and axis of a case: the frame with the nozzle at the origin and injection along -z.

They come from the scene, else from the case's injectors, else from its parcels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.cfd.case import CfdCase, Cloud, triple
from cldit.cfd.formats import find_format, read_case
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Parcels

_SNAP_DEG = 10.0  # the mean velocity of a noisy spray is no better known than that
_ONE_NOZZLE_M = 5e-3  # holes of one injector lie closer together than that
_YOUNG = 100  # parcels from which the nozzle is taken
_FEWEST = 8  # for a parabola through them
_SHARE = 0.1  # of the liquid's length: largest error of an inferred nozzle; of another error: none
_ENDED = 0.05  # of the oldest age: if the youngest parcel is older, the injection has ended
_AFTER_END_m = 1e-3  # largest error of a nozzle that is inferred after the end of injection


@dataclass(frozen=True)
class InjectorFrame:
    """Nozzle nozzle_m (3,) and unit axis (3,) in the case's coordinates; remarks on their source.

    error_m: error of a nozzle inferred from parcels; else 0.
    """

    nozzle_m: Floats
    axis: Floats
    remarks: tuple[str, ...]
    error_m: float = 0.0

    @property
    def rotation(self) -> Floats:
        """Shortest proper rotation that takes the axis to -z (Rodrigues), (3, 3)."""
        target = np.array([0.0, 0.0, -1.0])
        cosine = float(self.axis @ target)
        if cosine < -1.0 + 1e-12:
            return np.diag([1.0, -1.0, -1.0])
        cross = cross_matrix(np.cross(self.axis, target))
        return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def cross_matrix(vector: Floats) -> Floats:
    """Matrix (3, 3) that takes x to the cross product of `vector` (3,) with x."""
    return np.cross(np.eye(3), vector)


def find_frame(spec: CfdSpray, case: CfdCase) -> InjectorFrame:
    """Nozzle and axis from the scene's `spec`, else the injectors of `case`, else its parcels."""
    remarks: list[str] = []
    share = spec.parcels_left_out
    axis = np.array(spec.axis) if spec.axis is not None else _axis(case, share, remarks)
    axis = axis / np.linalg.norm(axis)
    error_m = 0.0
    if spec.nozzle_m is not None:
        nozzle = np.array(spec.nozzle_m)
        _check_place(case, nozzle)
    else:
        nozzle, error_m = _nozzle(case, axis, share, remarks)
    return InjectorFrame(nozzle, axis, tuple(dict.fromkeys(remarks)), error_m)


def _unknown(
    case: CfdCase,
    reason: str,
    quantity: str = "nozzle and axis of the injection",
    keys: str = "spray.nozzle_m and spray.axis",
) -> SprayError:
    return SprayError(f"{case.source}: {quantity} cannot be inferred ({reason}); set {keys}")


def _finite(cloud: Cloud, names: Sequence[str], share: float, remarks: list[str]) -> Mask:
    """True for parcels with finite values; of a field, one or `share` of all may be undefined."""
    finite = np.ones(len(cloud.position_m.values), dtype=bool)
    for column in (cloud.position_m, *(cloud.fields[name] for name in names)):
        good = np.isfinite(column.values).reshape(len(finite), -1).all(axis=1)
        finite &= good
        if good.all():
            continue
        bad = np.flatnonzero(~good)
        place = triple(cloud.position_m.values[bad[0]])
        problem = f"{column.label}: {len(bad)} of {len(finite)} parcels have no finite value"
        problem = f"{problem}, such as parcel {bad[0]} at {place} m"
        if len(bad) > max(1.0, share * len(finite)):
            limit = f"one, or {100 * share:g} % (spray.parcels_left_out)"
            raise SprayError(f"{problem}; allowed: {limit}; or set spray.nozzle_m and spray.axis")
        remarks.append(f"{problem}: ignored for nozzle and axis.")
    return finite


def _axis(case: CfdCase, share: float, remarks: list[str]) -> Floats:
    if case.injectors:
        units = [hole.direction / np.linalg.norm(hole.direction) for hole in case.injectors]
        mean = np.mean(units, axis=0)
        if np.linalg.norm(mean) < 0.1:
            raise _unknown(case, f"the injectors of {case.injectors[0].source} oppose each other")
        axis = _snapped(mean, 0.1)  # removes the rounding of a ring of holes
        remarks.append(f"Injection axis {triple(axis)}, from {case.injectors[0].source}.")
        return axis
    if (cloud := case.cloud) is None:
        raise _unknown(case, "it has no parcels")
    velocity = cloud.fields.get("U")
    if velocity is None or velocity.values.ndim != 2:
        raise _unknown(case, f"cloud {cloud.name!r} has no velocity U")
    finite = _finite(cloud, ("U", "nParticle", "rho", "d"), share, remarks)
    momentum = cloud.masses[finite, None] * velocity.values[finite]
    mean = momentum.sum(axis=0)
    if not np.linalg.norm(mean) > 0.2 * np.linalg.norm(momentum, axis=1).sum():
        raise _unknown(case, f"the parcels of {velocity.label} have no common direction")
    across = momentum - np.outer(momentum @ mean, mean) / (mean @ mean)
    error_deg = 2 * np.degrees(np.sqrt(np.sum(across**2)) / np.linalg.norm(mean))
    if error_deg > _SNAP_DEG:
        reason = f"{velocity.label} gives it within {error_deg:.2g} degrees only"
        raise _unknown(case, reason, "the axis of the injection", "spray.axis")
    axis = _snapped(mean, _SNAP_DEG)
    remarks.append(f"Injection axis {triple(axis)}, from the mean velocity in {velocity.label}.")
    return axis


def _nozzle(case: CfdCase, axis: Floats, share: float, remarks: list[str]) -> tuple[Floats, float]:
    if case.injectors:
        positions = np.array([injector.position_m for injector in case.injectors])
        nozzle = positions.mean(axis=0)
        if np.linalg.norm(positions - nozzle, axis=1).max() > _ONE_NOZZLE_M:
            raise _unknown(case, f"{case.injectors[0].source} has injectors in several places")
        remarks.append(f"Nozzle at {triple(nozzle)} m, from {case.injectors[0].source}.")
        return np.asarray(nozzle), 0.0
    if (cloud := case.cloud) is None:
        raise _unknown(case, "it has no parcels")
    if "U" not in cloud.fields or "age" not in cloud.fields:
        missing = "U" if "U" not in cloud.fields else "age"
        raise _unknown(case, f"cloud {cloud.name!r} has no {missing} to trace parcels back with")
    finite = _finite(cloud, ("U", "age"), share, remarks)
    columns = (cloud.position_m, cloud.fields["U"], cloud.fields["age"])
    place, velocity, age = (np.asarray(column.values[finite], np.float64) for column in columns)
    nozzle, error_m = extrapolated(place, velocity, age, axis)
    length_m = float(np.ptp(place @ axis))
    limit_m = _SHARE * length_m
    if age.min() > _ENDED * age.max():
        limit_m = min(limit_m, _AFTER_END_m)
    if not error_m <= max(limit_m, 1e-9):
        raise _unknown(
            case,
            f"the paths of its youngest parcels, {1e3 * age.min():.2g} ms old or older, give it "
            f"within {1e3 * error_m:.2g} mm only, and the parcels fill {1e3 * length_m:.2g} mm",
            "the nozzle",
            "spray.nozzle_m",
        )
    remarks.append(
        f"Nozzle at {triple(nozzle)} m +- {error_m * 1e3:.2g} mm, from the paths of the youngest "
        f"parcels in {cloud.position_m.label}, extrapolated to age zero; spray.nozzle_m sets it "
        "exactly."
    )
    return np.asarray(nozzle), error_m


def extrapolated(
    position_m: Floats, velocity_m_s: Floats, age_s: Floats, axis: Floats
) -> tuple[Floats, float]:
    """Nozzle (3,) and its error [m], from positions and velocities (N, 3) and ages (N,).

    A parcel that is traced back along its present velocity ends too far downstream, as drag slowed
    it. Along the axis, a parabola in age through the youngest parcels gives the value at age zero;
    across it their median is taken, as drag has no preferred side. The error is two standard
    errors of the fit, and the parabola's difference from a straight line; after the end of
    injection also half of the distance that is extrapolated.
    """
    young = np.argsort(age_s, kind="stable")[:_YOUNG]
    born = position_m[young] - velocity_m_s[young] * age_s[young, None]
    along = born @ axis
    age = age_s[young] / max(float(age_s[young].max()), 1e-30)
    if len(young) < _FEWEST or not np.ptp(age) > 0.0:
        travelled = np.linalg.norm(velocity_m_s[young], axis=1) * age_s[young]
        return np.median(born, axis=0), float(np.ptp(along) + travelled.max())
    zero, errors = [], []
    for degree in (1, 2):
        powers = age[:, None] ** np.arange(degree + 1)
        fit, *_ = np.linalg.lstsq(powers, along, rcond=None)
        scatter = np.sum((along - powers @ fit) ** 2) / (len(along) - degree - 1)
        zero.append(float(fit[0]))
        errors.append(float(np.sqrt(scatter * np.linalg.inv(powers.T @ powers)[0, 0])))
    across = born[: _YOUNG // 2] - np.outer(along[: _YOUNG // 2], axis)
    side = np.median(across, axis=0)
    error_side = float(np.linalg.norm(across.std(axis=0)) / np.sqrt(len(across)))
    model = abs(zero[1] - zero[0])
    if age_s.min() > _ENDED * age_s.max():  # paths near the nozzle are unknown
        model = max(model, 0.5 * abs(zero[1] - float(np.median(along))))
    error = np.hypot(2 * errors[1] + model, 2 * error_side)
    return side + zero[1] * axis, float(error)


def _check_place(case: CfdCase, nozzle: Floats) -> None:
    """Refuses a nozzle farther from the mesh than the mesh is wide; hint at mm or cm."""
    low, high = case.mesh.extent_m
    size = float(np.linalg.norm(high - low))

    def gap_m(place: Floats) -> float:
        return float(np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0)))

    if gap_m(nozzle) <= size:
        return
    scaled = [(nozzle * factor, unit) for factor, unit in ((1e-3, "mm"), (1e-2, "cm"))]
    meant = [f"{triple(at)} m if {unit} were meant" for at, unit in scaled if gap_m(at) <= size]
    hint = f": {', '.join(meant)}" if meant else ""
    raise SprayError(
        f"spray.nozzle_m: {triple(nozzle)} m is {gap_m(nozzle):.3g} m away from the case, which "
        f"is {triple(low)} to {triple(high)} m; coordinates are metres{hint}"
    )


def check_downstream(spec: CfdSpray, parcels: Parcels, frame: InjectorFrame) -> None:
    """Refuses a nozzle and axis that place more than half of the liquid behind the nozzle."""
    mass = parcels.masses_kg
    share = float(mass[parcels.position_m[:, 2] > 0.0].sum() / mass.sum()) if mass.sum() else 0.0
    if share > 0.5:
        depth = -parcels.position_m[:, 2]
        raise SprayError(
            f"{spec.file}: {100 * share:.3g} % of the liquid is upstream of the nozzle "
            f"{triple(frame.nozzle_m)} m by the axis {triple(frame.axis)} (parcels lie "
            f"{depth.min():.4g} to {depth.max():.4g} m along it); set spray.nozzle_m and spray.axis"
        )


def _snapped(vector: Floats, within_deg: float) -> Floats:
    """Returns the nearest coordinate axis if it is within the angle, else the unit vector."""
    unit = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(unit)))
    if abs(unit[main]) < np.cos(np.radians(within_deg)):
        return np.asarray(unit)
    axis = np.zeros(3)
    axis[main] = np.sign(unit[main])
    return axis


def with_one_frame(
    spec: CfdSpray, times: Sequence[float], *, watch: Watch = silent
) -> tuple[CfdSpray, tuple[str, ...]]:
    """Fixes nozzle and axis at the time that gives them best, so that all images of a series match.

    Looks at the last time, the one in the middle, at a quarter and so on, until one has no error,
    or an unimportant one. Returns the case, and remarks; unchanged if they are given or the file is
    cldit's own.
    """
    if find_format(spec) == "cldit" or (spec.nozzle_m is not None and spec.axis is not None):
        return spec, ()
    frames: list[InjectorFrame] = []
    problems: list[SprayError] = []
    places = [len(times) - 1]
    while places[-1] > 0:
        places.append(places[-1] // 2)
    for place in places:
        dated = spec.model_copy(update={"time_s": times[place]})
        try:
            frames.append(find_frame(dated, read_case(dated, watch)))
        except SprayError as error:
            problems.append(error)
        if frames and frames[-1].error_m <= _SHARE * _AFTER_END_m:
            break
    if not frames:
        raise problems[0]
    best = min(frames, key=lambda frame: frame.error_m)
    nozzle_m, axis = (tuple(map(float, vector)) for vector in (best.nozzle_m, best.axis))
    return spec.model_copy(update={"nozzle_m": nozzle_m, "axis": axis}), best.remarks
