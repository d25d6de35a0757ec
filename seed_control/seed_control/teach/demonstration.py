# SPDX-License-Identifier: Apache-2.0
"""What was shown: poses of the tip and forces by time, and whether they can be believed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from seed_control.teach.settings import TeachSettings
from seed_core.errors import SeedError
from seed_core.spatial import Array

STEP = 0.02  # [s] of the even samples
SMOOTH = 0.2  # [s] over which forces are averaged: a hand trembles at 8 to 12 Hz, and images have noise
TURNING = 0.5  # [s] likewise for rotations, in which a soft grasp swings
SLOW, TOUCH = 0.003, 1.0  # [m/s], [N] up to which the tip stands still, in the air
SAME = 1e-4  # [s] within which stamps are of one image
FEWEST = 10  # measurements
NO_ROTATION = 0.01  # by which columns of a rotation are not orthonormal
MOST_FORCE = 200.0  # [N]
LEAST = 1.0  # [s] of a demonstration


class TeachError(SeedError):
    """A demonstration from which no task can be made."""


class Recorder:
    """Takes measurements as they come; those of one image once."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, Array, Array]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, stamp: float, X_W_tip: Array, force: Array) -> None:
        """Pose of the tip (4, 4) and force (3,) [N] of the tool on the environment, in W, of the image at stamp [s]."""
        if not self._rows or abs(stamp - self._rows[-1][0]) > SAME:
            self._rows.append((stamp, np.array(X_W_tip, float), np.array(force, float)))

    def demonstration(self) -> Demonstration:
        """All of them. Raises TeachError: nothing has come."""
        if not self._rows:
            raise TeachError("nothing was measured: does the estimator see the tool, and was the grasp initialized?")
        stamps, poses, forces = zip(*self._rows, strict=True)
        return Demonstration(np.array(stamps), np.stack(poses), np.stack(forces))


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Measurements in the order of time.

    Attributes:
        stamps: (n,) [s]. X_W_tip: (n, 4, 4) of the tip.
        forces: (n, 3) [N] of the tool on the environment, in W.
    """

    stamps: Array
    X_W_tip: Array
    forces: Array

    def check(self, settings: TeachSettings) -> None:
        """Raises TeachError: too short, not finite, with a gap or a jump; which, when, and what to do."""
        if len(self.stamps) < FEWEST:
            raise TeachError(f"the demonstration has {len(self.stamps)} measurements; at least {FEWEST} are needed")
        t = self.stamps - self.stamps[0]
        self._check_values(t)
        self._check_times(t, settings)
        self._check_jumps(t, settings)

    def _check_values(self, t: Array) -> None:
        """Every number by itself; t (n,) [s] since the start."""
        for name, values in (("time", t), ("pose", self.X_W_tip), ("force", self.forces)):
            bad = np.flatnonzero(~np.isfinite(values.reshape(len(t), -1)).all(axis=1))
            if len(bad):
                raise TeachError(f"the {name} of measurement {bad[0] + 1} is not a number: teach again")
        off = np.abs(np.swapaxes(self.X_W_tip[:, :3, :3], 1, 2) @ self.X_W_tip[:, :3, :3] - np.eye(3)).max(axis=(1, 2))
        if off.max() > NO_ROTATION:
            raise TeachError(f"the pose of measurement {int(np.argmax(off)) + 1} has no rotation: teach again")
        size = np.linalg.norm(np.clip(self.forces, -1e9, 1e9), axis=1)
        if size.max() > MOST_FORCE:
            raise TeachError(
                f"the force of measurement {int(np.argmax(size)) + 1} is {size.max():.3g} N, at most {MOST_FORCE:g} N "
                "can be taught: is it in newtons?"
            )

    def _check_times(self, t: Array, settings: TeachSettings) -> None:
        """How long, in order, and without a gap."""
        if t[-1] < LEAST:
            raise TeachError(f"the demonstration lasts {max(t[-1], 0.0):.1f} s; at least {LEAST:g} s are needed")
        dt = np.diff(t)
        if (dt <= 0.0).any():
            k = int(np.argmax(dt <= 0.0))
            raise TeachError(f"time goes backwards after {t[k]:.2f} s: two runs in one recording, or clocks set back")
        k = int(np.argmax(dt))
        if dt[k] > settings.gap:
            raise TeachError(
                f"the demonstration has a gap of {dt[k]:.2f} s after {t[k]:.2f} s, at most {settings.gap:g} s: the "
                "estimator lost the tool, or messages were lost; teach again"
            )

    def _check_jumps(self, t: Array, settings: TeachSettings) -> None:
        """How fast place, rotation and force change from one measurement to the next."""
        dt = np.diff(t)
        turned = (self.rotations[:-1].inv() * self.rotations[1:]).magnitude()
        moved = np.linalg.norm(np.diff(self.X_W_tip[:, :3, 3], axis=0), axis=1)
        changed = np.linalg.norm(np.diff(self.forces, axis=0), axis=1)
        for what, values, bound, unit, scale, why in (
            ("tip", moved, settings.jump, "m/s", 1e3, "mm"),
            ("tip's rotation", np.rad2deg(turned), settings.turn_jump, "deg/s", 1.0, "degrees"),
            ("force", changed, settings.force_jump, "N/s", 1.0, "N"),
        ):
            rates = values / np.maximum(dt, STEP)
            k = int(np.argmax(rates))
            if rates[k] > bound:
                raise TeachError(
                    f"the {what} jumps by {scale * values[k]:.1f} {why} within {dt[k]:.3f} s, {t[k]:.2f} s after the "
                    f"start ({rates[k]:.3g} {unit}, at most {bound:g}): the tool slipped, or an estimate was wrong; "
                    "take the tool again and teach slowly"
                )

    @property
    def rotations(self) -> Rotation:
        """Of the tip, in W."""
        return Rotation.from_matrix(self.X_W_tip[:, :3, :3])

    def moving(self, slow: float = SLOW, touch: float = TOUCH) -> Demonstration:
        """Without what stood still, in the air, before and after.

        Args:
            slow: [m/s]. touch: [N].
        """
        step, doing = self._doing(slow, touch)
        if not len(doing):
            return self
        keep = slice(max(int(doing[0]) - step, 0), int(doing[-1]) + step + 1)
        return Demonstration(self.stamps[keep], self.X_W_tip[keep], self.forces[keep])

    @property
    def moves(self) -> bool:
        """Whether anything moved or touched, as `moving` has it by itself."""
        return bool(len(self._doing(SLOW, TOUCH)[1]))

    def _doing(self, slow: float, touch: float) -> tuple[int, NDArray[np.int_]]:
        """Samples of half a second, and those in which the tip moves or touches."""
        step = max(round(0.5 * len(self.stamps) / max(self.stamps[-1] - self.stamps[0], 1e-9)), 1)
        p, n = self.X_W_tip[:, :3, 3], len(self.stamps)
        i = np.arange(n)
        a, b = np.maximum(i - step // 2, 0), np.minimum(i + step // 2 + 1, n - 1)
        speed = np.linalg.norm(p[b] - p[a], axis=1) / np.maximum(self.stamps[b] - self.stamps[a], 1e-9)
        return step, np.flatnonzero((speed > slow) | (np.linalg.norm(self.forces, axis=1) > touch))

    def even(self) -> Demonstration:
        """The same, smoothed and in steps of STEP.

        The path by a spline whose smoothness is found by generalised cross-validation, so that noise goes and corners
        stay (make_smoothing_spline of SciPy, after Wahba 1990).
        """
        t = np.arange(self.stamps[0], self.stamps[-1], STEP)
        window = 2 * round(0.5 * SMOOTH / STEP) + 1
        f = np.column_stack([np.interp(t, self.stamps, column) for column in self.forces.T])
        X = np.tile(np.eye(4), (len(t), 1, 1))
        since = self.stamps - self.stamps[0]  # of seconds since 1970 the spline would see steps
        splines = [make_smoothing_spline(since, column) for column in self.X_W_tip[:, :3, 3].T]
        X[:, :3, 3] = np.column_stack([spline(t - self.stamps[0]) for spline in splines])
        turns, mean = Slerp(self.stamps, self.rotations)(t), self.rotations.mean()
        smooth = uniform_filter1d((mean.inv() * turns).as_rotvec(), round(TURNING / STEP), axis=0, mode="nearest")
        X[:, :3, :3] = (mean * Rotation.from_rotvec(smooth)).as_matrix()
        return Demonstration(t, X, uniform_filter1d(f, window, axis=0, mode="nearest"))
