"""From a CFD case's coordinates to the project's: nozzle at the origin, injection along -z.

What the scene leaves out is inferred, from the case's injectors or else from its parcels, and
said in a sentence for the user.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cldit.cfd.case import CfdCase, Cloud
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from cldit.spray.result import Floats

_SNAP_DEG = 10.0  # the mean velocity of a noisy spray is no better known than that
_ONE_NOZZLE_M = 5e-3  # holes of one injector lie closer together than that
_YOUNG = 20  # parcels from which the nozzle is taken


@dataclass(frozen=True)
class Frame:
    """nozzle_m (3,) and unit axis (3,) in the case's coordinates; remarks on their origin."""

    nozzle_m: Floats
    axis: Floats
    remarks: tuple[str, ...]

    @property
    def rotation(self) -> Floats:
        """(3, 3): the shortest proper rotation that takes the axis to -z (Rodrigues)."""
        target = np.array([0.0, 0.0, -1.0])
        cosine = float(self.axis @ target)
        if cosine < -1.0 + 1e-12:
            return np.diag([1.0, -1.0, -1.0])
        x, y, z = np.cross(self.axis, target)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def find_frame(spec: CfdSpray, case: CfdCase) -> Frame:
    """Nozzle and axis from the scene's `spec`, else the injectors of `case`, else its parcels.

    Raises:
        SprayError: they cannot be told; the message names the scene keys to set.
    """
    remarks: list[str] = []
    axis = np.array(spec.axis) if spec.axis is not None else _axis(case, remarks)
    axis = axis / np.linalg.norm(axis)
    if spec.nozzle_m is not None:
        nozzle = np.array(spec.nozzle_m)
    else:
        nozzle = _nozzle(case, axis, remarks)
    return Frame(nozzle, axis, tuple(remarks))


def _unknown(case: CfdCase, why: str) -> SprayError:
    return SprayError(
        f"{case.source}: nozzle and axis of the injection cannot be inferred ({why}); "
        "set spray.nozzle_m and spray.axis"
    )


def _text(vector: Floats) -> str:
    return "(" + ", ".join(f"{0.0 if abs(part) < 1e-12 else part:.4g}" for part in vector) + ")"


def _axis(case: CfdCase, remarks: list[str]) -> Floats:
    if case.injectors:
        units = [each.direction / np.linalg.norm(each.direction) for each in case.injectors]
        mean = np.mean(units, axis=0)
        if np.linalg.norm(mean) < 0.1:
            raise _unknown(case, f"the injectors of {case.injectors[0].source} oppose each other")
        axis = _snapped(mean, 0.1)  # takes off the rounding of a ring of holes, no more
        remarks.append(f"Injection axis {_text(axis)}, from {case.injectors[0].source}.")
        return axis
    cloud = _cloud_or_fail(case)
    velocity = cloud.fields.get("U")
    if velocity is None or velocity.values.ndim != 2:
        raise _unknown(case, f"cloud {cloud.name!r} has no velocity U")
    mass = np.prod([cloud.fields[name].values for name in ("nParticle", "rho")], axis=0)
    momentum = (mass * cloud.fields["d"].values ** 3)[:, None] * velocity.values
    if not np.all(np.isfinite(momentum)):
        raise SprayError(f"{velocity.label}: is not finite everywhere")
    mean = momentum.sum(axis=0)
    if not np.linalg.norm(mean) > 0.2 * np.linalg.norm(momentum, axis=1).sum():
        raise _unknown(case, f"the parcels of {velocity.label} have no common direction")
    axis = _snapped(mean, _SNAP_DEG)
    remarks.append(f"Injection axis {_text(axis)}, from the mean velocity in {velocity.label}.")
    return axis


def _nozzle(case: CfdCase, axis: Floats, remarks: list[str]) -> Floats:
    if case.injectors:
        positions = np.array([each.position_m for each in case.injectors])
        nozzle = positions.mean(axis=0)
        if np.linalg.norm(positions - nozzle, axis=1).max() > _ONE_NOZZLE_M:
            raise _unknown(case, f"{case.injectors[0].source} has injectors in several places")
        remarks.append(f"Nozzle at {_text(nozzle)} m, from {case.injectors[0].source}.")
        return np.asarray(nozzle)
    cloud = _cloud_or_fail(case)
    position = cloud.position_m.values
    velocity, age = cloud.fields.get("U"), cloud.fields.get("age")
    if velocity is not None and age is not None:
        # the youngest parcels, taken back along their paths to where they were born
        young = np.argsort(age.values, kind="stable")[:_YOUNG]
        born = position[young] - velocity.values[young] * age.values[young, None]
        nozzle, how = np.median(born, axis=0), "the paths of the youngest parcels"
    else:
        upstream = np.argsort(position @ axis, kind="stable")[:_YOUNG]
        middle = np.median(position[upstream], axis=0)
        nozzle = middle + (float((position @ axis).min()) - float(middle @ axis)) * axis
        how = "the parcels farthest upstream"
    if not np.all(np.isfinite(nozzle)):
        raise SprayError(f"{cloud.position_m.label}: the nozzle inferred from it is not finite")
    remarks.append(
        f"Nozzle at {_text(nozzle)} m, from {how} in {cloud.position_m.label}; "
        "spray.nozzle_m sets it exactly."
    )
    return np.asarray(nozzle)


def _cloud_or_fail(case: CfdCase) -> Cloud:
    if case.cloud is None:
        raise _unknown(case, "there are no parcels")
    return case.cloud


def _snapped(vector: Floats, within_deg: float) -> Floats:
    """The nearest coordinate axis if it is within the angle, else the unit vector."""
    unit = vector / np.linalg.norm(vector)
    main = int(np.argmax(np.abs(unit)))
    if abs(unit[main]) < np.cos(np.radians(within_deg)):
        return np.asarray(unit)
    axis = np.zeros(3)
    axis[main] = np.sign(unit[main])
    return axis
