# SPDX-License-Identifier: Apache-2.0
"""The camera clock offset: the cameras' clock against the robot's, from the motion between the poses of a run.

The tool is held fast, so that arm and cameras watch the same motion: the offset is the shift in time that makes them
agree best. Gain and bias of each axis are free, hence a wrong estimate that is only wrong in size does not matter.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from seed_core.errors import FailedError
from seed_core.spatial import Array, so3_log

FARTHEST, STEP = 0.3, 0.005  # [s] of the offsets that are tried
OFFSETS = np.arange(-FARTHEST, FARTHEST + 0.5 * STEP, STEP)  # [s]
BLOCKS = 8  # of time, each left out once, for the standard deviation
TRUSTED = 0.005  # [s] of standard deviation
LEAST = 200  # estimates
MOST = 20_000  # readings that are kept of each stream
FLOOR = 1e-5  # [m], [rad] of noise that every estimate has
SHOWN = 1e-4  # [m], [rad] rms of motion that both streams must share on one axis at least


class ClockError(FailedError):
    """The offset cannot be told from these readings."""


@dataclass(frozen=True)
class ClockOffset:
    """By which the stamps of images are ahead of the robot's, and its standard deviation [s]."""

    value: float
    std: float

    @property
    def advice(self) -> str:
        """What to do about it, or ''."""
        if abs(self.value) < max(2.0 * self.std, 0.002):
            return ""
        ahead = "ahead of" if self.value > 0.0 else "behind"
        return (
            f"the images' stamps are {1e3 * abs(self.value):.1f} +- {1e3 * self.std:.1f} ms {ahead} the robot's: "
            "give the clocks.yaml of this run to the launch (clocks:=)"
        )


class ClockWatch:
    """Remembers both streams; `offset` afterwards."""

    def __init__(self) -> None:
        self._robot: deque[Array] = deque(maxlen=MOST)
        self._camera: deque[Array] = deque(maxlen=MOST)

    def robot(self, stamp: float, X_TC: Array) -> None:
        """A pose (4, 4) of C in the fixed tool from the arm's joints, at its stamp [s]."""
        self._robot.append(_row(stamp, X_TC))

    def camera(self, stamp: float, X_TC: Array) -> None:
        """The same from images."""
        self._camera.append(_row(stamp, X_TC))

    @property
    def seen(self) -> bool:
        """Whether there are cameras at all."""
        return bool(self._camera)

    def offset(self) -> ClockOffset:
        """The shift in time that makes both streams agree best.

        Raises:
            ClockError: too few readings, too little motion that both streams show, or no offset that fits best.
        """
        robot, camera = (np.array(rows).reshape(-1, 7) for rows in (self._robot, self._camera))
        if len(robot) > 1:
            inside = (camera[:, 0] > robot[0, 0] + FARTHEST) & (camera[:, 0] < robot[-1, 0] - FARTHEST)
            camera = camera[inside]
        if len(robot) < 2 or len(camera) < LEAST:
            raise ClockError(f"the clocks cannot be compared: {len(camera)} estimates, {LEAST} are needed")
        sums = np.array([_sums(robot, camera, offset) for offset in OFFSETS])  # (offsets, BLOCKS, 6, 6)
        whole = sums.sum(axis=1)
        left_out = [_best(whole - sums[:, block]) for block in range(BLOCKS)]
        value, std = _best(whole), float(np.std(left_out)) * float(np.sqrt(BLOCKS - 1))  # the jackknife's
        shared = _shared(whole)
        if not shared >= SHOWN:
            raise ClockError(
                f"the clocks cannot be compared: arm and images share {1e3 * shared:.3f} mm or mrad of motion (at "
                f"least {1e3 * SHOWN:g}): the estimates do not follow the tool, or the arm moved too little"
            )
        if not np.isfinite([value, std]).all():
            raise ClockError(
                f"the clocks cannot be compared: no offset within {FARTHEST:g} s fits best: the arm moved too little, "
                "or the clocks are farther apart"
            )
        if std > TRUSTED:
            raise ClockError(
                f"the clocks cannot be compared: offset {value:.3f} +- {std:.3f} s, the arm moved too little"
            )
        return ClockOffset(value, std)


def _row(stamp: float, X: Array) -> Array:
    return np.array([stamp, *so3_log(X[:3, :3]), *X[:3, 3]])


def _sums(robot: Array, camera: Array, offset: float) -> Array:
    """(BLOCKS, 6, 6): per block and axis the sums 1, r, c, rr, rc, cc of robot r and camera c."""
    r = np.array([np.interp(camera[:, 0] - offset, robot[:, 0], robot[:, i]) for i in range(1, 7)])
    c = camera[:, 1:].T
    terms = np.stack([np.ones_like(r), r, c, r * r, r * c, c * c], axis=2)
    return np.array([part.sum(axis=1) for part in np.array_split(terms, BLOCKS, axis=1)])


def _scatter(sums: Array) -> tuple[Array, Array, Array]:
    """Of sums (..., 6): the squares of robot and camera about their means, and what the robot explains of those."""
    n, r, c, rr, rc, cc = np.moveaxis(sums, -1, 0)
    of_robot, both = rr - r * r / n, rc - r * c / n
    return of_robot, cc - c * c / n, both**2 / np.maximum(of_robot, 1e-12)


def _shared(sums: Array) -> float:
    """Rms [m, rad] of the motion that both streams show on the axis that shows most, at its best offset."""
    of_robot, _, explained = _scatter(sums)
    return float(np.sqrt((np.minimum(of_robot, explained) / sums[..., 0]).max()))


def _best(sums: Array) -> float:
    """The offset of least residual, each axis weighed by its own noise; nan where none within reach fits best."""
    _, of_camera, explained = _scatter(sums)
    left = np.maximum(of_camera - explained, 0.0) + sums[..., 0] * FLOOR**2
    cost = (left / left.min(axis=0)).sum(axis=1)
    i = int(np.argmin(cost))
    if i in (0, len(OFFSETS) - 1):
        return float("nan")
    a, b, d = cost[i - 1 : i + 2]
    return float(OFFSETS[i] + STEP * np.clip(0.5 * (a - d) / max(a - 2.0 * b + d, 1e-12), -1.0, 1.0))
