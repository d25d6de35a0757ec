# SPDX-License-Identifier: Apache-2.0
"""What the membranes did at a pose, as a sample keeps it: optional, by finger, since version 2 of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from seed_core.estimate import DEFORMATIONS, MembraneMotion
from seed_core.hand import FINGERS
from seed_core.spatial import Array, make_pose, pose_from_rpy, rpy_from_rotation

_LENGTHS = {"motion": 6, "deformation": DEFORMATIONS, "area": 1, "centroid": 3, "indentation": 1, "pressure": 1}
_OPTIONAL = ("area", "centroid", "indentation", "pressure")


@dataclass(frozen=True)
class MembraneSample:
    """One finger's membrane at rest; None where it was not told.

    Attributes:
        motion: X_CM as x, y, z [m], roll, pitch, yaw [rad]; deformation: (9,) [m], as in `MembraneMotion`.
        area: [m^2]. centroid: [m] in C. indentation: [m]. pressure: [hPa].
    """

    finger: str
    motion: tuple[float, ...]
    deformation: tuple[float, ...]
    area: float | None = None
    centroid: tuple[float, ...] | None = None
    indentation: float | None = None
    pressure: float | None = None

    @property
    def estimate(self) -> MembraneMotion:
        """As an estimator reports it."""
        nan = float("nan")
        return MembraneMotion(
            finger=self.finger,
            X_CM=pose_from_rpy(self.motion[3:], self.motion[:3]),
            deformation=np.array(self.deformation),
            area=nan if self.area is None else self.area,
            centroid=np.full(3, nan) if self.centroid is None else np.array(self.centroid),
            indentation=nan if self.indentation is None else self.indentation,
            pressure=nan if self.pressure is None else self.pressure,
        )


def mean_pose(X: Sequence[Array]) -> Array:
    """Mean (4, 4) of poses (4, 4) that lie close together."""
    turn = Rotation.from_matrix(np.array([x[:3, :3] for x in X])).mean().as_matrix()
    return make_pose(turn, np.mean([x[:3, 3] for x in X], axis=0))


def mean_membrane(readings: Sequence[tuple[MembraneMotion, ...]]) -> tuple[MembraneSample, ...]:
    """The mean over readings that tell both fingers and their deformation; () where none does."""
    told = [r for r in readings if len(r) == 2 and all(len(m.deformation) == DEFORMATIONS for m in r)]
    fingers = sorted({m.finger for r in told for m in r})
    return tuple(_mean([m for r in told for m in r if m.finger == finger]) for finger in fingers)


def _mean(motions: list[MembraneMotion]) -> MembraneSample:
    X = mean_pose([m.X_CM for m in motions])
    centroid = _known(np.array([m.centroid for m in motions]))
    return MembraneSample(
        finger=motions[0].finger,
        motion=tuple(float(v) for v in (*X[:3, 3], *rpy_from_rotation(X[:3, :3]))),
        deformation=tuple(np.mean([m.deformation for m in motions], axis=0).tolist()),
        area=_one([m.area for m in motions]),
        centroid=None if centroid is None else tuple(centroid.tolist()),
        indentation=_one([m.indentation for m in motions]),
        pressure=_one([m.pressure for m in motions]),
    )


def _known(values: Array) -> Array | None:
    """Mean of the rows that are finite; None where none is."""
    finite = values[np.isfinite(values).all(axis=1)]
    return np.asarray(finite.mean(axis=0)) if len(finite) else None


def _one(values: list[float]) -> float | None:
    mean = _known(np.array(values)[:, None])
    return None if mean is None else float(mean[0])


def since(sample: MembraneSample, first: MembraneSample) -> MembraneSample:
    """The motion counted from another sample of the same finger instead of the grasp."""
    X, X0 = (pose_from_rpy(s.motion[3:], s.motion[:3]) for s in (sample, first))
    R = X[:3, :3] @ X0[:3, :3].T
    moved = make_pose(R, X[:3, 3] - R @ X0[:3, 3])
    return replace(
        sample,
        motion=tuple(float(v) for v in (*moved[:3, 3], *rpy_from_rotation(R))),
        deformation=tuple((np.array(sample.deformation) - first.deformation).tolist()),
    )


def from_json(entry: Any) -> MembraneSample:
    """From a mapping. Raises ValueError with what is wrong."""
    if not isinstance(entry, dict) or entry.get("finger") not in FINGERS:
        raise ValueError(f"membrane: {entry!r} must be a mapping with finger: left or right")
    values: dict[str, Any] = {"finger": entry["finger"]}
    for name, length in _LENGTHS.items():
        value = entry.get(name)
        if value is None and name in _OPTIONAL:
            continue
        numbers: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
        good = all(isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v) for v in numbers)
        if not good or len(numbers) != length:
            raise ValueError(f"membrane.{name} = {value!r} must be {length} finite numbers")
        values[name] = tuple(float(v) for v in numbers) if length > 1 else float(numbers[0])
    return MembraneSample(**values)
