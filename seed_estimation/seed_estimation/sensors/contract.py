# SPDX-License-Identifier: Apache-2.0
"""What an estimator of the tool's pose is to nodes, simulation and validation, and what a sensor gives to one.

There are two ways to bring a sensor of one's own (docs/other_sensors.md):
- `GraspEstimator`: everything from images to `RelativePoseEstimate`. The bubbles' `Estimator` is one, which fits one
  motion to the pixels of both bubbles; `SensorEstimator` is another.
- `Sensor`: one finger, frame by frame: its patch, and scalar measurements which a rigid motion of the tool must
  explain. `SensorEstimator` makes poses with covariance from one or two of them. The gel is one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array
from seed_estimation.contact.patch import ContactPatch


class Stamped(Protocol):
    """Whatever a sensor delivers at one time."""

    @property
    def stamp(self) -> float: ...  # [s]


Image = TypeVar("Image", bound=Stamped)
In = TypeVar("In", bound=Stamped, contravariant=True)


class GraspEstimator(Protocol[In]):
    """Pose of the grasped tool from frames: what one or both fingers deliver at one time, by 'left' and 'right'."""

    @property
    def fingers(self) -> tuple[str, ...]: ...
    @property
    def patches(self) -> Mapping[str, ContactPatch]: ...  # of the last frame, by finger

    def capture_reference(self, frames: Sequence[Mapping[str, In]]) -> None:
        """The fingers touch nothing. Raises EstimatorError."""

    def initialize_grasp(self, frames: Sequence[Mapping[str, In]]) -> None:
        """The tool is grasped and rests: T := C. Raises EstimatorError."""

    def update(self, frame: Mapping[str, In], stamp: float) -> RelativePoseEstimate:
        """The pose at stamp [s] with covariance, axes observed and slip; never raises on a bad frame, but says why."""

    def debug_image(self) -> NDArray[np.uint8]:
        """(H, W, 3) BGR, to look at."""


class Rows(NamedTuple):
    """Scalar measurements of one kind, each in its standard deviations, at one pose of the tool.

    Attributes:
        r: (M,) predicted less measured.
        J: (M, 6) change of r with a small motion exp(w, v) X_CT: rotation w [rad], then translation v [m], both in C.
        independent: how many of them count: neighbours err alike.
    """

    r: Array
    J: Array
    independent: float


class Observation(Protocol):
    """What one finger saw at one time."""

    @property
    def patch(self) -> ContactPatch: ...

    def rows(self, X_CT: Array) -> Sequence[Rows]:
        """Measurements at the tool's pose X_CT (4, 4); asked for at each step of the fit."""

    def explained(self, X_CT: Array) -> float:
        """Share, 0 to 1, of the material in contact that moves as X_CT says."""

    def slip(self, X_CT: Array) -> float:
        """Share, 0 to 1, of the tool's motion that the edge of the patch does not follow."""


class Sensor(Protocol[In]):
    """One finger. Poses are in C, the hand's compliance frame; identity is the moment of grasp."""

    def problem(self, image: In) -> str:
        """Why an image cannot be used, or ''."""

    def capture_reference(self, images: Sequence[In]) -> None:
        """The finger touches nothing. Raises EstimatorError."""

    def initialize_grasp(self, images: Sequence[In]) -> ContactPatch:
        """The tool is grasped and rests. Raises EstimatorError: nothing touches, or what touches cannot be followed."""

    def observe(self, image: In, X_CT: Array) -> Observation:
        """One image; X_CT (4, 4): where the tool should be."""

    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) BGR of the last image, with what was found in it."""


def point_rows(J_point: Array, points: Array) -> Array:
    """(M, 6) from gradients (M, 3) by points (M, 3) in C: a motion (w, v) moves a point by w x p + v."""
    return np.concatenate([np.cross(points, J_point), J_point], axis=1)


def direction_rows(J_direction: Array, directions: Array) -> Array:
    """(M, 6) from gradients (M, 3) by directions (M, 3) in C, which turn and do not shift: w x n."""
    return np.concatenate([np.cross(directions, J_direction), np.zeros_like(J_direction)], axis=1)
