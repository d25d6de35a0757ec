# SPDX-License-Identifier: Apache-2.0
"""The tool's pose from one or two fingers of any kind that is a `Sensor`."""

from collections.abc import Mapping, Sequence
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from seed_core.config import checked
from seed_core.estimate import NO_GRASP, NO_TOUCH, REFUSED, RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_core.spatial import Array, make_pose, so3_exp, so3_log
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.images.checks import SET_BACK, EstimatorError
from seed_estimation.report import LET_GO, RELEASED, SLIPPED, invalid
from seed_estimation.sensors.contract import Image, Observation, Sensor
from seed_estimation.sensors.fit import Fit, fit
from seed_estimation.sensors.parameters import SensorEstimatorParameters

PREDICTED = 0.1  # [s] longest time over which the velocity is taken to stay


class SensorEstimator(Generic[Image]):
    """Pose of the grasped tool: a `GraspEstimator` over sensors.

    Attributes:
        fingers: by name. patches: of the last frame.
    """

    def __init__(
        self, sensors: Mapping[str, Sensor[Image]], parameters: SensorEstimatorParameters, method: str
    ) -> None:
        """sensors: by 'left' and 'right', one or both; method: the name that estimates bear.

        Raises:
            EstimatorError: no sensor, or one of another finger.
        """
        unknown = [f for f in sensors if f not in FINGERS]
        if unknown or not sensors:
            raise EstimatorError(f"sensors of {sorted(sensors) or 'no finger'}: give 'left', 'right' or both")
        self.parameters, self.method = checked(parameters, "SensorEstimatorParameters"), method
        self.fingers = tuple(f for f in FINGERS if f in sensors)
        self.patches: dict[str, ContactPatch] = {}
        self._sensors = {f: sensors[f] for f in self.fingers}
        self._referenced = self._grasped = self._slid = False
        self._X_CT, self._rate, self._stamp = np.eye(4), np.zeros(6), -np.inf
        self._lost = 0  # frames in a row
        self._touched = -np.inf  # [s]
        self._no_grasp = NO_GRASP  # why there is none

    def capture_reference(self, frames: Sequence[Mapping[str, Image]]) -> None:
        """The fingers touch nothing. Raises EstimatorError."""
        series = self._usable(frames, "reference")
        for f, sensor in self._sensors.items():
            sensor.capture_reference(series[f])
        self._referenced, self._grasped, self._no_grasp = True, False, NO_GRASP

    def initialize_grasp(self, frames: Sequence[Mapping[str, Image]]) -> None:
        """The tool is grasped and rests: T := C. Raises EstimatorError."""
        if not self._referenced:
            raise EstimatorError("no reference: capture one with the fingers touching nothing before a grasp")
        # also where the new one is refused: it was asked for since the old one is none
        self._grasped, self._slid, self._no_grasp = False, False, REFUSED
        series = self._usable(frames, "grasp")
        self.patches = {f: sensor.initialize_grasp(series[f]) for f, sensor in self._sensors.items()}
        self._X_CT, self._rate = np.eye(4), np.zeros(6)
        self._grasped, self._lost = True, 0
        self._stamp = self._touched = min(images[-1].stamp for images in series.values())

    def _usable(self, frames: Sequence[Mapping[str, Image]], purpose: str) -> dict[str, list[Image]]:
        """The good images of each finger."""
        out: dict[str, list[Image]] = {}
        for f, sensor in self._sensors.items():
            problems = [sensor.problem(frame[f]) if f in frame else "no image" for frame in frames]
            out[f] = [frame[f] for frame, problem in zip(frames, problems, strict=True) if not problem]
            if not out[f]:
                why = problems[-1] if problems else "no images"
                raise EstimatorError(f"{purpose}: no usable image of the {f} finger: {why}")
        return out

    def update(self, frame: Mapping[str, Image], stamp: float) -> RelativePoseEstimate:
        """The pose at stamp [s], of the older finger's image; never raises on a bad frame, but says why."""
        p = self.parameters
        problem = self._problem(frame, stamp)
        if problem:
            self.patches = {}
            return self._invalid(stamp, problem)
        dt, start = stamp - self._stamp, self._predicted(stamp)
        self._stamp = stamp
        seen = {f: sensor.observe(frame[f], start) for f, sensor in self._sensors.items()}
        self.patches = {f: o.patch for f, o in seen.items()}
        touching = [f for f in self.fingers if self.patches[f].in_contact]
        if touching or stamp < self._touched:
            self._touched = stamp
        elif self._grasped and stamp - self._touched > LET_GO:  # what is held next is held otherwise
            self._grasped, self._slid, self._no_grasp = False, False, RELEASED
        if not self._grasped:
            return self._invalid(stamp, self._no_grasp)
        if self._slid:
            return self._invalid(stamp, SLIPPED)
        if not touching:
            return self._invalid(stamp, f"{NO_TOUCH}; searching")
        observations = [seen[f] for f in touching]
        found = fit(observations, start, p.iterations)
        # a sensor may have measured no numbers
        told = np.isfinite(found.X_CT).all() and np.isfinite(found.covariance).all()
        share = min(o.explained(found.X_CT) for o in observations) if told else 0.0
        if not share >= p.lock:
            self._lost, self._rate = self._lost + 1, np.zeros(6)
            self._slid = self._lost >= p.patience
            words = f"no one motion explains more than {share:.0%} of the material in contact"
            return self._invalid(stamp, SLIPPED if self._slid else f"track lost: {words}; searching")
        self._follow(found.X_CT, dt)
        return self._report(stamp, found, observations, touching)

    def _problem(self, frame: Mapping[str, Image], stamp: float) -> str:
        if not np.isfinite(stamp):
            return f"stamp {stamp} is not a time"
        if stamp < self._stamp - SET_BACK:
            self._stamp, self._rate = -np.inf, np.zeros(6)
        elif stamp <= self._stamp:
            return f"stamp {stamp:.6f} s is not later than the one before, {self._stamp:.6f} s: came out of order"
        missing = [f for f in self.fingers if f not in frame]
        if missing:
            return f"no image of the {' and '.join(missing)} finger: is the camera running?"
        stamps = [frame[f].stamp for f in self.fingers]
        if not max(stamps) - min(stamps) <= self.parameters.max_skew:
            return f"images of left and right are {max(stamps) - min(stamps):.3f} s apart"
        if not self._referenced:
            return "no reference: capture_reference has not been called"
        told = {f: sensor.problem(frame[f]) for f, sensor in self._sensors.items()}
        return next((f"{f}: {words}" for f, words in told.items() if words), "")

    def _predicted(self, stamp: float) -> Array:
        """X_CT (4, 4) expected at a time [s], at constant velocity."""
        dt = min(max(stamp - self._stamp, 0.0), PREDICTED)
        return make_pose(so3_exp(self._rate[:3] * dt) @ self._X_CT[:3, :3], self._X_CT[:3, 3] + self._rate[3:] * dt)

    def _follow(self, X_CT: Array, dt: float) -> None:
        """Takes a pose as the tool's, dt [s] after the frame before."""
        turn = so3_log(X_CT[:3, :3] @ self._X_CT[:3, :3].T)
        step = np.concatenate([turn, X_CT[:3, 3] - self._X_CT[:3, 3]])
        self._rate = step / dt if 0.0 < dt <= PREDICTED and self._lost == 0 else np.zeros(6)
        self._X_CT, self._lost = X_CT, 0

    def _report(
        self, stamp: float, found: Fit, observations: Sequence[Observation], touching: Sequence[str]
    ) -> RelativePoseEstimate:
        p = self.parameters
        motion = np.concatenate([so3_log(found.X_CT[:3, :3]), found.X_CT[:3, 3]])
        turn, way = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
        covariance = found.covariance + np.diag(np.square(p.share_std * np.array([turn] * 3 + [way] * 3)))
        deviation = np.sqrt(np.diag(covariance))
        roll, pitch, yaw = (bool(d < p.max_std_rotation) for d in deviation[:3])
        x, y, z = (bool(d < p.max_std_translation) for d in deviation[3:])
        words = [f"{f} finger touches nothing" for f in self.fingers if f not in touching]
        words += ["reduced: one finger only"] if len(touching) < 2 else []
        words += ["some axes are not observed"] if not all((x, y, z, roll, pitch, yaw)) else []
        return RelativePoseEstimate(
            stamp, found.X_CT, covariance, (x, y, z, roll, pitch, yaw), reason="; ".join(words),
            slip=max(o.slip(found.X_CT) for o in observations), method=self.method,
        )  # fmt: skip

    def _invalid(self, stamp: float, reason: str) -> RelativePoseEstimate:
        return invalid(stamp, reason, self.method, gross_slip=self._slid)

    def debug_image(self) -> NDArray[np.uint8]:
        """(H, W, 3) BGR: the fingers beside each other."""
        return np.hstack([sensor.picture() for sensor in self._sensors.values()])
