# SPDX-License-Identifier: Apache-2.0
"""The spring's wrench against the arm's own force/torque reading at the flange.

An arm's reading has an offset of many newtons. In free space, where the tool's weight tells the load, the offset is
found; from then on the reading tells the spring's wrench wherever the arm goes, within what its offset drifts and its
gain is off. A reading that steps while the spring's wrench does not has another offset: it is found anew.
"""

from collections import deque
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from seed_control.monitor.contradiction import WindowTest
from seed_control.monitor.weight_check import FreeSpaceSample
from seed_control.wrench.estimate import Measurement
from seed_core.errors import SeedError
from seed_core.hand import GRAVITY, Tool
from seed_core.spatial import Array, Wrench, inverse_pose, length, wrench_adjoint
from seed_core.wrench_settings import ReferenceSettings

_SPAN = 0.03  # [s] around an image within which readings are averaged
_KEPT = 400  # readings
_LEAST = 8  # samples in free space before the offset is known
_MOST = 40  # of them that the offset is the mean of
_MATCH = 0.016  # [s] by which reading and image may be apart
_STEPS, _UPDATES = 6.0, 2  # deviations by which a reading steps, within so many updates, whose offset is another
_STUCK = 100  # readings in a row that are the very same
SET_BACK = 1.0  # [s] a reading older than the last by this: the clock was set back
BOUNDS = 2000.0, 500.0  # [N], [N m] that no reading at a flange is beyond


class SpringByArm(NamedTuple):
    """(6,) of (torque, force) of the tool's spring on the tool about T's origin in T, with (6, 6) covariances."""

    wrench: Array
    random: Array
    systematic: Array


class ArmCheck:
    """`add` each reading, `update` ten times a second; `reason` says what does not agree.

    Attributes:
        reading: the newest that could be compared, None otherwise.
    """

    def __init__(self, settings: ReferenceSettings, X_EC: Array, tool: Tool) -> None:
        self._settings, self._X_EC = settings, X_EC
        self._mass = settings.mass_deviation * tool.mass * GRAVITY  # [N]
        s = settings
        self._noise = np.array((s.arm_torque_noise,) * 3 + (s.arm_force_noise,) * 3) ** 2
        self._offset = np.array((s.arm_torque_offset,) * 3 + (s.arm_force_offset,) * 3) ** 2
        self._test = WindowTest(s.force_tolerance, s.torque_tolerance)
        self._readings: deque[tuple[float, Array]] = deque(maxlen=_KEPT)
        self._newest = -inf
        self._same = 0
        self._zeros: deque[Array] = deque(maxlen=_MOST)
        self._zero: Array | None = None  # (6,) of the reading in E
        self._zeroed = -inf  # [s] of the last step of the offset
        self._last: tuple[float, Array] | None = None
        self._before: deque[tuple[Array, Array]] = deque(maxlen=_UPDATES)  # (6,) told by the model, and off by
        self.reading: SpringByArm | None = None
        self.reason = ""

    def reset(self) -> None:
        """A new grasp; the reading's offset stays."""
        self._test.reset()
        self._before.clear()
        self._last, self.reading, self.reason = None, None, ""

    @property
    def there(self) -> bool:
        """Whether the arm has ever told one."""
        return self._newest > -inf

    def add(self, stamp: float, load: Wrench) -> None:
        """One reading: load on the flange about its origin, in E.

        Raises:
            SeedError: its stamp does not rise, a value is not finite or beyond what a flange endures.
        """
        v = load.vector()
        if not (isfinite(stamp) and np.isfinite(v).all()):
            raise SeedError(f"arm_wrench at {stamp} s has a value that is not finite: {v} (N m, N)")
        if stamp < self._newest - SET_BACK:
            self._set_back()
        elif stamp <= self._newest:
            raise SeedError(f"arm_wrench of {stamp:.3f} s comes after one of {self._newest:.3f} s")
        force, torque = float(np.abs(v[3:]).max()), float(np.abs(v[:3]).max())
        if force > BOUNDS[0] or torque > BOUNDS[1]:
            raise SeedError(
                f"arm_wrench tells {force:.4g} N, {torque:.4g} N m; at most {BOUNDS[0]:g} N, {BOUNDS[1]:g} N m: "
                "is it in other units?"
            )
        self._same = self._same + 1 if self._readings and np.array_equal(self._readings[-1][1], v) else 0
        self._readings.append((stamp, v))
        self._newest = stamp

    def update(
        self, m: Measurement, spring: Wrench, weight: Wrench, random: Array, free: list[FreeSpaceSample], t: float
    ) -> None:
        """Compare with a measurement.

        Args:
            spring: as the model tells it, uncorrected, in T. weight: of the tool, likewise.
            random: (6, 6) covariance of the spring's wrench by the pose.
            free: measurements of the past at which the tool is now known to have hung free.
            t: now [s].
        """
        self.reading = None
        if not self.there:
            return
        if self._newest > t + SET_BACK:  # readings of a time to come; one is due from now on
            self._set_back()
            self._newest = t
        if why := self._why_unusable(t):
            self.reason = why
            self._test.reset()
            return
        self._learn_zero(free)
        at, told = self._at(m.stamp), spring.vector()
        last, self._last = self._last, (m.stamp, told)
        last = None if last is not None and m.stamp <= last[0] else last
        if self._zero is None or at is None:
            self.reason = ""
            return
        change = told - last[1] if last is not None else np.zeros(6)
        rate = change / max(m.stamp - last[0], 1e-3) if last is not None else change
        carried = np.zeros(6) if self._settings.arm_weighs_tool else weight.vector()
        r = self._of_spring(m, at[0] - self._zero, self._noise / at[1], carried, rate)
        if self._steps(told, told - r.wrench, random + r.random):
            self._zeros.clear()
            self._zero, self._zeroed = None, m.stamp + _SPAN
            self._test.reset()
            self.reason = ""
            return
        self.reading = r
        share = self._settings.share_tolerance * length(told[3:])
        self._test.add(m.stamp, told - r.wrench, random + r.random, r.systematic, share)
        if not self._test.significant:
            self.reason = ""
        elif self._test.to_be_told(t):
            self.reason = self._words(told)

    def _set_back(self) -> None:
        """The clock was: no reading is as old as what comes now."""
        self._readings.clear()
        self._zeroed = -inf

    def _steps(self, told: Array, difference: Array, random: Array) -> bool:
        """Whether the reading has stepped by itself since one of the last updates: its sensor was zeroed, say.

        Args:
            told: (6,) by the model. difference: (6,) of that and the reading. random: (6, 6) covariance of that.
        """
        for before in self._before:
            step, loaded = (difference - before[1])[3:], length((told - before[0])[3:])
            size = length(step)
            if size > loaded:
                step = step * (1.0 - loaded / size)  # a wrong stiffness goes with the load
                if float(step @ np.linalg.solve(2.0 * random[3:, 3:], step)) > _STEPS**2:
                    self._before.clear()
                    return True
        self._before.append((told, difference))
        return False

    def _why_unusable(self, t: float) -> str:
        """What is wrong with the readings at t [s], whatever they tell; '' for nothing."""
        silent, most = t - self._newest, self._settings.arm_timeout
        if silent > most:
            return f"arm_wrench is silent: none for {silent:.2f} s, at most {most:g} s"
        if self._same >= _STUCK:
            return f"arm_wrench is stuck: the very same reading {self._same} times in a row"
        return ""

    def _learn_zero(self, free: list[FreeSpaceSample]) -> None:
        """The reading's offset, from moments at which the tool's weight tells the load."""
        for s in free:
            if s.verified and s.m.stamp > self._zeroed and (at := self._at(s.m.stamp)) is not None:
                hanging = s.load if self._settings.arm_weighs_tool else np.zeros(6)
                self._zeros.append(at[0] - self._on_flange(s.m, hanging))
        if len(self._zeros) >= _LEAST:
            self._zero = np.mean(self._zeros, axis=0)

    def _words(self, told: Array) -> str:
        assert self._test.difference is not None
        assert self.reading is not None
        size = length(told[3:])
        reading = length(self.reading.wrench[3:])
        return (
            f"the grasp's spring of {size:.2f} N differs from arm_wrench ({reading:.2f} N) {self._test.told()}: "
            "is the stiffness of this grasp and grip, and was the grasp taken free of load?"
        )

    def _at(self, stamp: float) -> tuple[Array, int] | None:
        """Mean reading (6,) around a time, and of how many; None without any near it on both sides."""
        near = [(t, v) for t, v in self._readings if abs(t - stamp) <= _SPAN]
        if not near or self._newest < stamp:
            return None
        if abs(sum(t for t, _ in near) / len(near) - stamp) > _MATCH:
            return None
        return np.asarray(np.mean([v for _, v in near], axis=0)), len(near)

    def _on_flange(self, m: Measurement, spring: Array) -> Array:
        """What the reading in E (6,) is of a spring's wrench on the tool about T in T (6,)."""
        X_ET = self._X_EC @ m.X_CT
        on_hand = Wrench.from_vector(-spring)
        R, p = X_ET[:3, :3], X_ET[:3, 3]
        return on_hand.about(-R.T @ p).rotated(R).vector()

    def _of_spring(self, m: Measurement, reading: Array, noise: Array, carried: Array, rate: Array) -> SpringByArm:
        """The spring's wrench by a reading in E without its offset.

        Args:
            noise: (6,) variances of the reading.
            carried: (6,) weight in T that the reading lacks.
            rate: (6,) change of the spring's wrench per second.
        """
        X_TE = inverse_pose(self._X_EC @ m.X_CT)
        R, p = X_TE[:3, :3], X_TE[:3, 3]
        wrench = Wrench.from_vector(-reading).about(-R.T @ p).rotated(R).vector() - carried
        A = wrench_adjoint(X_TE)
        n = max(1, len(self._zeros))
        random = A @ np.diag(noise) @ A.T + np.diag((_MATCH * rate) ** 2)
        gain = self._settings.arm_gain * wrench
        systematic = A @ np.diag(self._offset + noise / n) @ A.T + np.diag(gain * gain)
        systematic[3:, 3:] += np.eye(3) * self._mass**2  # the offset was found under a weight that is known so well
        return SpringByArm(wrench, random, systematic)
