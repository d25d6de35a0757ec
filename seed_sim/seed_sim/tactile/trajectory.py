# SPDX-License-Identifier: Apache-2.0
"""Motions of the tool in the grasp over all six axes at once, as in the paper's Fig. 4."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from seed_core.config import field
from seed_core.spatial import Array, pose_from_rpy
from seed_core.vector3 import Vector3

_PERIODS = (2.9, 4.7, 7.3)  # [s]; no two have a common multiple within a run
_STEP_OF_AXIS = 0.071  # each axis has periods of its own
_SOFT_START = 1.0  # [s]


@dataclass(frozen=True)
class TrajectorySection:
    """Sums of three sines per axis, with phases from the seed, starting smoothly at rest in the grasp."""

    duration: float = field(25.0, unit="s", low=1.0, high=3600.0, doc="of the motion")
    rate: float = field(45.0, unit="Hz", low=1.0, high=200.0, doc="pairs of images per second")
    translation_mm: Vector3 = field((4.5, 2.1, 3.0), unit="mm rms", low=0.0, high=20.0, doc="x, y, z")
    rotation_deg: Vector3 = field((8.0, 6.0, 6.0), unit="deg rms", low=0.0, high=30.0, doc="roll, pitch, yaw")
    peak_deg: Vector3 | None = field(None, unit="deg", low=0.0, high=60.0, doc="largest roll, pitch, yaw, not rms")
    scale: float = field(1.0, low=0.0, high=5.0, doc="of all that; membranes let a tool go that moves too far")
    score_from: float = field(0.0, unit="s", low=0.0, high=600.0, doc="frames before it are not scored")


def poses(section: TrajectorySection, seed: int) -> Iterator[tuple[float, Array]]:
    """Time [s] and X_CT (4, 4) of each frame."""
    times = np.arange(1, int(section.duration * section.rate) + 1) / section.rate
    values = _waves(times, np.random.default_rng((seed, 4)))
    values *= np.concatenate([np.asarray(section.translation_mm), np.asarray(section.rotation_deg)])
    if section.peak_deg is not None:
        values[:, 3:] = _waves(times, np.random.default_rng((seed, 4)))[:, 3:]
        values[:, 3:] *= np.asarray(section.peak_deg) / np.abs(values[:, 3:]).max(axis=0)
    values *= section.scale
    for t, v in zip(times, values, strict=True):
        yield float(t), pose_from_rpy(np.deg2rad(v[3:]), 1e-3 * v[:3])


def _waves(times: Array, rng: np.random.Generator) -> Array:
    """(N, 6) of unit rms over the run."""
    out = np.zeros((len(times), 6))
    for axis in range(6):
        for period in _PERIODS:
            frequency = 2.0 * np.pi / (period * (1.0 + _STEP_OF_AXIS * axis))
            out[:, axis] += np.sin(frequency * times + rng.uniform(0.0, 2.0 * np.pi))
    ramp = np.clip(times / _SOFT_START, 0.0, 1.0)[:, None]
    out *= ramp**2 * (3.0 - 2.0 * ramp)
    return np.asarray(out / np.sqrt((out**2).mean(axis=0)))
