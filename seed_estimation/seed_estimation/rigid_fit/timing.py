# SPDX-License-Identifier: Apache-2.0
"""Images that are not of one time: fingers skewed against each other, and depth that lags behind infrared.

What is stamped is known: the fit puts each finger's tool where it was at that finger's own stamp, at the speed of the
frame before (`Course`). What is not stamped shows while the tool moves: with v the tool's speed, images that are late
by s ask for a pose that is v s behind the others'. With H the information of all images, H_l and g_l that of the late
ones, and the pose free to give way, least squares finds s, as it does the micro-slip: a scalar Kalman filter.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.residuals import motion_vector, solved

DOUBT = 20.0  # pixels are not independent: a frame's information counts this much less
SYSTEMATIC = 0.004  # [s] what errors of depth and mounts pretend
ALIKE = 0.25  # [s] over which those errors stay what they are
WANDER = 0.002  # [1] [s/sqrt(s)] how fast a delay may change
LARGEST = 0.15  # [s] of a delay
NAMED, SURE = 0.004, 4.0  # [s], [deviations] from which on a delay is told


class Late(NamedTuple):
    """What one frame tells of a delay.

    Attributes:
        step: by which the delay would have to change [s].
        information: about it [1/s^2].
        effect: (6,) change of the pose per second of delay, [rotation, translation] in the tool's frame.
    """

    step: float
    information: float
    effect: Array


def late(H: Array, g: Array, H_late: Array, g_late: Array, speed: Array) -> Late:
    """H, g: (6, 6), (6,) of all images; H_late, g_late: of the late ones; speed: (6,) of the tool, in its frame."""
    column = H_late @ speed
    effect = -solved(H, column)
    information = float(speed @ column + column @ effect)
    gradient = float(speed @ g_late + effect @ g)
    return Late(gradient / max(information, 1e-9), max(information, 0.0), effect)


def share(H: Array, H_late: Array, speed: Array, other: Array) -> float:
    """As how much of the speed (6,) another one counts [1]; H, H_late: as of `late`."""
    column = H_late @ speed
    seen = column - H_late @ solved(H, column)
    return float(other @ seen) / max(float(speed @ seen), 1e-9)


def in_frame(X_CT: Array, rate: Array) -> Array:
    """A rate (6,) in C in the frame of a tool at X_CT (4, 4)."""
    return np.concatenate((rate[:3] @ X_CT[:3, :3], rate[3:] @ X_CT[:3, :3]))


@dataclass
class Delay:
    """A delay that is learnt.

    Attributes:
        start: deviation of what it may be [s]; 0: it is none, and nothing is learnt.
        least: value that it cannot be less than [s].
        estimate, variance: of the filter [s], [s^2].
    """

    start: float
    least: float = -LARGEST
    estimate: float = 0.0
    variance: float = field(init=False)

    def __post_init__(self) -> None:
        self.variance = self.start**2

    @property
    def value(self) -> float:
        """What is corrected for [s]: as far as it is clearly more than its deviation."""
        return self.estimate**3 / (self.estimate**2 + self.variance) if self.estimate else 0.0

    @property
    def deviation(self) -> float:
        """Of the value [s]."""
        return float(np.hypot(np.sqrt(self.variance), self.estimate - self.value))

    @property
    def told(self) -> bool:
        """Whether it is large and sure enough to be named."""
        return bool(abs(self.estimate) > max(NAMED, SURE * self.variance**0.5))

    def update(self, frame: Late, applied: float, dt: float) -> None:
        """Takes a frame that was fitted with a delay `applied` [s], dt after the one before [s]."""
        self.variance = min(self.variance + WANDER**2 * dt, self.start**2)
        if self.variance <= 0.0 or frame.information <= 0.0 or not np.isfinite(frame.step):
            return
        noise = DOUBT / frame.information + SYSTEMATIC**2 * max(ALIKE / dt, 1.0)
        gain = self.variance / (self.variance + noise)
        wanted = min(max(applied + frame.step, -LARGEST), LARGEST)
        self.estimate = min(max(self.estimate + gain * (wanted - self.estimate), self.least), LARGEST)
        self.variance *= 1.0 - gain


@dataclass(frozen=True, eq=False)
class Course:
    """Where the tool was when each finger's images were taken.

    Attributes:
        rate: (6,) [rotation vector, translation] per second, in C, that the fit goes by.
        last: (6,) of the tool in the frame before.
        behind: by how much each finger's images are older than the frame [s]; not named: by nothing.
    """

    rate: Array
    last: Array
    behind: Mapping[str, float]

    def at(self, X_CT: Array, finger: str) -> Array:
        """(4, 4) for one finger when the tool is at X_CT at the frame's time."""
        behind = self.behind.get(finger, 0.0)
        if behind == 0.0:
            return X_CT
        step = -behind * self.rate
        return make_pose(so3_exp(step[:3]) @ X_CT[:3, :3], X_CT[:3, 3] + step[3:])


class Timing:
    """Both delays of one grasp.

    Attributes:
        skew: of the right finger's images behind the left one's, beyond what stamps say.
        lag: of depth behind infrared.
        covariance: (6, 6) of the last frame's pose, [rotation, translation] in the tool's frame, by what is not known.
    """

    def __init__(self, skew: float, lag: float) -> None:
        """Deviations [s] of what both may be before anything is seen."""
        self.skew, self.lag = Delay(skew), Delay(lag, least=0.0)  # no depth runs ahead of infrared
        self.covariance = np.zeros((6, 6))
        self._step = np.zeros(6)

    def behind(self, stamps: Mapping[str, float], stamp: float) -> dict[str, float]:
        """By how much each finger's images are older than the frame's stamp [s]."""
        out = {finger: stamp - own for finger, own in stamps.items()}
        if len(out) > 1:
            out["right"] += self.skew.value
        return out

    def learn(self, fit: Fit, X_before: Array, dt: float, course: Course | None) -> None:
        """From a fit that is believed, dt [s] after the tool was at X_before (4, 4); course: in force in the fit."""
        speed = motion_vector(inverse_pose(X_before) @ fit.X_CT) / dt
        depth = late(fit.H, fit.g, fit.H_depth, fit.g_depth, speed)
        self.lag.update(depth, 0.0, dt)
        effects = [self.lag.deviation * depth.effect]
        right = next((f for f in fit.fingers if f.model.finger == "right"), None)
        if right is not None and len(fit.fingers) > 1:
            H, g = right.image.H + right.depth.H, right.image.g + right.depth.g
            other = late(fit.H, fit.g, H, g, speed)
            applied = self.skew.value
            if course is not None:  # an averaged speed is not as large: a skew that makes up for that would grow on
                apart = course.behind.get("right", 0.0) - course.behind.get("left", 0.0)
                applied += apart * share(fit.H, H, speed, in_frame(fit.X_CT, course.rate - course.last))
            self.skew.update(other, applied, dt)
            effects.append(self.skew.deviation * other.effect)
        if course is not None:  # a speed that changes puts a finger where it was not
            change = speed - in_frame(fit.X_CT, course.rate)
            for finger in fit.fingers:
                behind = course.behind.get(finger.model.finger, 0.0)
                effects.append(behind * late(fit.H, fit.g, finger.image.H + finger.depth.H, fit.g, change).effect)
        self._apply(effects, depth)

    def resume(self, fit: Fit, X_before: Array, dt: float) -> None:
        """From a fit after a pause, or of a track that is found again, dt [s] after X_before (4, 4): nothing is learnt.

        What the lag does goes by the mean speed since then.
        """
        speed = motion_vector(inverse_pose(X_before) @ fit.X_CT) / dt if dt > 0.0 else np.zeros(6)
        depth = late(fit.H, fit.g, fit.H_depth, fit.g_depth, speed)
        self._apply([self.lag.deviation * depth.effect], depth)

    def _apply(self, effects: list[Array], depth: Late) -> None:
        """To the pose of this frame: effects of what is not known, and the lag's."""
        self._step = -self.lag.value * depth.effect
        S = np.stack(effects, axis=1)
        self.covariance = S @ S.T

    def corrected(self, X_CT: Array) -> Array:
        """X_CT (4, 4) of the frame last learnt from, without what the depth's lag does to it."""
        return X_CT @ make_pose(so3_exp(self._step[:3]), self._step[3:])

    def words(self) -> list[str]:
        """What is told to users."""
        told = []
        if self.skew.told:
            later = "older" if self.skew.estimate > 0.0 else "newer"
            told.append(f"the right finger's images are {1e3 * abs(self.skew.estimate):.0f} ms {later} than stamped")
        if self.lag.told:
            told.append(f"depth lags behind infrared by {1e3 * self.lag.estimate:.0f} ms")
        return told

    def values(self) -> dict[str, float]:
        """For diagnostics [ms]."""
        delays = {"finger_skew": self.skew, "depth_lag": self.lag}
        out = {f"{name}_ms": round(1e3 * delay.estimate, 1) for name, delay in delays.items()}
        return out | {f"{name}_std_ms": round(1e3 * delay.variance**0.5, 1) for name, delay in delays.items()}
