# SPDX-License-Identifier: Apache-2.0
"""The arm's kinematics as configured: published lengths, or those of one individual arm from a calibration file.

The file is the YAML that ur_calibration writes (`kinematics: shoulder: {x, y, ...}`).
"""

from collections.abc import Sequence
from math import hypot
from pathlib import Path

import numpy as np

from seed_core.arm.quaternion import to_pose
from seed_core.arm.target_checks import Target
from seed_core.config import plain_yaml
from seed_core.errors import SeedError
from seed_core.spatial import Array, inverse_pose, pose_from_rpy
from seed_driver.config import DriverConfig
from seed_ur.kinematics import KinematicsError, URKinematics

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
CONVERGED = 1e-9  # [m, rad]
FAR = 100.0  # [m, rad] nothing in a calibration is so large
PLAUSIBLE = 0.03  # [m] that a calibration may move the flange


def arm_kinematics(config: DriverConfig) -> URKinematics:
    """The arm's kinematics.

    Raises:
        SeedError: the calibration file is missing or wrong, or of another arm.
    """
    nominal = URKinematics.for_model(config.model)
    return load_calibration(config.calibration_file, nominal) if config.calibration_file else nominal


class CalibratedKinematics(URKinematics):
    """Joint i turns about z of a frame that sits at `origins[i]` (4, 4) in the one before.

    The inverse asks the nominal arm for X D^-1, where D is the small difference of both arms' forward kinematics at
    the last answer: a fixed point that gains a factor of about 1000 per turn, because calibrations are millimetres.
    """

    def __init__(self, nominal: URKinematics, origins: Array) -> None:
        super().__init__(nominal.model)
        self.origins = origins

    def forward(self, q: Sequence[float] | Array) -> Array:
        """X_WE (4, 4) for joint angles q (6,) [rad]."""
        X = np.eye(4)
        for origin, angle in zip(self.origins, q, strict=True):
            c, s = np.cos(angle), np.sin(angle)
            X = X @ origin
            X[:, :2] = X[:, :2] @ np.array(((c, -s), (s, c)))
        return X

    def inverse(self, X_WE: Array, near: Sequence[float] | Array) -> Array:
        """Joint angles (6,) [rad] nearest to `near`; raises KinematicsError."""
        q = super().inverse(X_WE, near)
        for _ in range(8):
            q = super().inverse(self._nominal_pose(X_WE, q), q)
            if np.abs(self.forward(q) - X_WE).max() < CONVERGED:
                return q
        raise KinematicsError("the calibrated inverse does not converge here (singular); move the arm away")

    def follow(self, X_WE: Array, near: Sequence[float]) -> list[float]:
        """As `inverse` for a pose close to that of `near`: one turn of the iteration."""
        return super().follow(self._nominal_pose(X_WE, near), near)

    def _nominal_pose(self, X_WE: Array, q: Sequence[float] | Array) -> Array:
        return X_WE @ inverse_pose(self.forward(q)) @ super().forward(q)


def load_calibration(path: str, nominal: URKinematics) -> CalibratedKinematics:
    """Kinematics of the arm whose calibration file is at `path`; `nominal` are those of its model.

    Raises:
        SeedError: file, entry and what was expected.
    """
    try:
        data = plain_yaml(Path(path).expanduser().read_text(encoding="utf-8"), path)
    except FileNotFoundError as error:
        raise SeedError(
            f"calibration_file = {path!r} does not exist; write one with ur_calibration, or leave the setting empty"
        ) from error
    except (OSError, RuntimeError) as error:  # the latter when ~name is nobody's home
        raise SeedError(f"calibration_file = {path!r} cannot be read: {error}") from error
    except UnicodeDecodeError as error:
        raise SeedError(f"{path}: not YAML: {error}") from error
    links = data.get("kinematics") if isinstance(data, dict) else None
    if not isinstance(links, dict):
        raise SeedError(f"{path}: has no 'kinematics' section with {', '.join(LINKS)}")
    origins = np.array([_origin(path, name, links.get(name)) for name in LINKS])
    arm = CalibratedKinematics(nominal, origins)
    _check_plausible(path, arm, nominal)
    return arm


def _origin(path: str, name: str, entry: object) -> Array:
    if not isinstance(entry, dict):
        raise SeedError(f"{path}: kinematics.{name} is missing; it needs {', '.join(KEYS)}")
    numbers: list[float] = []
    for key in KEYS:
        number = entry.get(key)
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) < FAR:
            raise SeedError(
                f"{path}: kinematics.{name}.{key} = {number!r} must be a finite number below {FAR:g} [m or rad]"
            )
        numbers.append(float(number))
    return pose_from_rpy(numbers[3:], numbers[:3])


def _check_plausible(path: str, arm: CalibratedKinematics, nominal: URKinematics) -> None:
    q = [0.3, -1.2, 1.4, -0.9, -1.3, 0.5]
    off = hypot(*(arm.forward(q) - nominal.forward(q))[:3, 3])
    if off > PLAUSIBLE:
        limit = f"limit {PLAUSIBLE} m"
        raise SeedError(f"{path}: is {off:.3f} m away from a {nominal.model.name} ({limit}): wrong model or file?")


def out_of_reach(target: Target, arm: URKinematics, joints: Sequence[float]) -> str:
    """Why the arm, with these joint angles (6,) [rad], cannot go to `target`; '' when it can."""
    try:
        arm.follow(to_pose(target.p, target.q), joints)
    except KinematicsError as error:
        return f"target_frame: {error}"
    return ""
