# SPDX-License-Identifier: Apache-2.0
"""Calibration of a hand's cameras and its file: written by `./seed calibrate`, loaded by the estimator."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from seed_core.config import ConfigError, field, load_file, save_file
from seed_core.hand import FINGERS, Frame, Hand
from seed_core.spatial import Array, rpy_from_rotation
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.tactile_images import Image

HEADER = (
    "# SPDX-License-Identifier: Apache-2.0\n"
    "# Range [m] and poses in C of a hand's cameras, found by ./seed calibrate.\n"
)
STEP = 4  # [px] between the nodes of the stored range offset
SAME = 1e-6  # [1], [m] by which two drawings of a camera's pose may differ


@dataclass(frozen=True)
class FingerCalibration:
    """One camera: its range offset on a grid of every STEP-th pixel, and its pose in C where that was found."""

    width: int = field(low=8, high=4096, unit="px")
    height: int = field(low=8, high=4096, unit="px")
    range_offset: list[list[float]] = field(
        [], unit="m", low=-0.05, high=0.05, doc="true minus measured; rows by columns"
    )
    pose: Frame | None = field(None, doc="optical frame in C; none: as the hand is drawn")
    drawn: Frame | None = field(None, doc="optical frame in C in the drawing from which the pose was found")

    def __post_init__(self) -> None:
        wanted = (-(-self.height // STEP), -(-self.width // STEP))
        shape = (len(self.range_offset), len(self.range_offset[0]) if self.range_offset else 0)
        if self.range_offset and (shape != wanted or any(len(r) != wanted[1] for r in self.range_offset)):
            raise ConfigError(
                f"range_offset has {shape} nodes; an image of {self.width} x {self.height} needs {wanted}"
            )

    def offset_map(self) -> Image:
        """(H, W) [m]; zero where none was calibrated."""
        if not self.range_offset:
            return np.zeros((self.height, self.width), np.float32)
        v, u = np.mgrid[: self.height, : self.width].astype(np.float32) / np.float32(STEP)
        grid = np.asarray(self.range_offset, np.float32)
        return np.asarray(cv2.remap(grid, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)


@dataclass(frozen=True)
class Calibration:
    """Range and camera poses of a hand, by finger."""

    fingers: dict[str, FingerCalibration] = field({}, doc="left, right")
    mutual_rotation_std: float = field(
        0.0, unit="rad", low=0.0, high=0.2, doc="of the cameras' poses to each other, about each axis of C; 0: not told"
    )
    mutual_position_std: float = field(
        0.0, unit="m", low=0.0, high=0.02, doc="of the cameras' poses to each other, along each axis; 0: not told"
    )

    def __post_init__(self) -> None:
        unknown = [f for f in self.fingers if f not in FINGERS]
        if unknown:
            raise ConfigError(f"fingers has the key '{unknown[0]}'; it may have: {', '.join(FINGERS)}")

    def hand(self, hand: Hand) -> Hand:
        """The hand with the calibrated camera poses.

        Raises:
            ConfigError: they were found from the drawing of another hand.
        """
        drawn, found = {"left": hand.C_L, "right": hand.C_R}, {}
        for finger, one in self.fingers.items():
            if one.pose is None:
                continue
            here, then = drawn[finger], one.drawn
            if then is not None and not np.allclose(then.pose, here.pose, atol=SAME):
                raise ConfigError(
                    f"the calibration is of another hand: its {finger} camera is drawn at {then.position} m, "
                    f"{then.rpy_deg} deg in C, this hand's at {here.position} m, {here.rpy_deg} deg: calibrate again "
                    "with this hand (--hand)"
                )
            found[finger] = one.pose
        return replace(hand, C_L=found.get("left", hand.C_L), C_R=found.get("right", hand.C_R))

    @property
    def mutual_deviation(self) -> Array | None:
        """(6,) [rad, m] of how both cameras lie to each other; None where that was not calibrated."""
        if not (self.mutual_rotation_std > 0.0 and self.mutual_position_std > 0.0):
            return None
        return np.repeat((self.mutual_rotation_std, self.mutual_position_std), 3)

    def range_offset(self, finger: str, shape: tuple[int, int]) -> Image:
        """(H, W) [m], true minus measured, of a finger's full image; 0 where not known.

        Raises:
            EstimatorError: it was calibrated with images of another shape.
        """
        one = self.fingers.get(finger)
        if one is None or not one.range_offset:
            return np.zeros(shape, np.float32)
        offset = one.offset_map()
        if offset.shape != shape:
            raise EstimatorError(f"range offset of {finger} has shape {offset.shape}; its camera has {shape}")
        return np.nan_to_num(offset)


def load(path: str | Path) -> Calibration:
    """What a file says, '' for nothing calibrated. Raises ConfigError with file and line."""
    return load_file(path, Calibration) if str(path) else Calibration()


def save(calibration: Calibration, path: Path) -> None:
    """As YAML, whole or not at all."""
    save_file(path, HEADER, calibration, compact=True)


def frame_of(X: Array) -> Frame:
    """A pose (4, 4) as position and angles."""
    x, y, z = X[:3, 3].tolist()
    roll, pitch, yaw = np.rad2deg(rpy_from_rotation(X[:3, :3])).tolist()
    return Frame((x, y, z), (roll, pitch, yaw))
