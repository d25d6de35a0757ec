# SPDX-License-Identifier: Apache-2.0
"""The tool's pose in the grasp as an estimator reports it (seed_msgs/RelativePose), and the pause at a new grasp."""

from dataclasses import dataclass, field, replace
from math import inf, nan

import numpy as np

from seed_core.spatial import Array, inverse_pose

LEAST = 10  # poses that are invalid; three in a row are enough
LASTING = 0.3  # [s]; a controller holds after 0.15 s without a valid pose
NEW_GRASP = "a new grasp is taken"  # in the reason of poses around such a moment
NO_GRASP = "no grasp: initialize_grasp has not been called since the last reference"
NO_TOOL = "no tool in the grasp"
NO_TOUCH = "the tool touches no finger"
REFUSED = "no grasp: the last one was refused; initialize the grasp again"  # a tool may be held
EMPTY = (NO_GRASP, NO_TOOL, NO_TOUCH)  # in the reason of poses while the gripper holds nothing
AXES = ("x", "y", "z", "roll", "pitch", "yaw")


DEFORMATIONS = 9  # see MembraneMotion.deformation


@dataclass(frozen=True)
class MembraneMotion:
    """What the membrane of one bubble does around the tool, since the grasp.

    The membrane is the spring: what its material does around the patch tells the wrench, whatever the tool does on it.

    Attributes:
        finger: 'left' or 'right'.
        X_CM: (4, 4) rigid motion of the material in a band around the patch (seed_core.membrane.material.BAND): a point
            p in C of it has moved to X_CM p.
        covariance: (6, 6) of rotation vector in C and translation in C, in rad^2, rad m and m^2.
        observed: whether its x, y, z, roll, pitch, yaw are seen, as in RelativePoseEstimate.
        deformation: (9,) [m] motion along x and z of C beyond X_CM, over (u, v) = (x, z) from the band's middle at the
            grasp in units of its root mean square distance from there: stretch (u, 0), stretch (0, v), shear (v, u);
            then u^2, u v, v^2 along x, and u^2, u v, v^2 along z. Empty where not told.
        area: of the patch [m^2]. centroid: (3,) its middle in C [m]. indentation: mean depth of the imprint [m].
        pressure: [hPa] in this bubble, absolute; not a number where nobody measures it.
    """

    finger: str
    X_CM: Array
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    observed: tuple[bool, bool, bool, bool, bool, bool] = (True,) * 6
    deformation: Array = field(default_factory=lambda: np.zeros(0))
    area: float = nan
    centroid: Array = field(default_factory=lambda: np.full(3, nan))
    indentation: float = nan
    pressure: float = nan


@dataclass(frozen=True)
class RelativePoseEstimate:
    """Pose of the tool T in the compliance frame C at the time an image was taken.

    Attributes:
        stamp: when the images were taken [s].
        X_CT: (4, 4).
        covariance: (6, 6) of rotation vector in C and translation in C, in rad^2, rad m and m^2.
        observed: whether the estimator sees each of AXES (x, y, z, roll, pitch, yaw): translation first, unlike the
            covariance. Read it by `observed_translation` and `observed_rotation`.
        valid: False means: do not use the pose; `reason` says why.
        slip: share of the tool's motion that the membrane does not follow, 0 (sticks) to 1.
        gross_slip: the tool has slid in the grasp since the last grasp; the pose is no longer relative to it.
        membrane: what the membranes do at this time, by finger; empty where the estimator does not tell.
        X_PT: (4, 4) how far the tool has slid on the membranes since the grasp: pose of the tool in the frame P of the
            patches, which lies where the tool would be had it stuck to them. I where it has not, or nobody tells.
        covariance_PT: (6, 6) of that, the part of `covariance` that is due to it.
    """

    stamp: float
    X_CT: Array
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    observed: tuple[bool, bool, bool, bool, bool, bool] = (True,) * 6
    valid: bool = True
    reason: str = ""
    slip: float = 0.0
    gross_slip: bool = False
    method: str = ""
    membrane: tuple[MembraneMotion, ...] = ()
    X_PT: Array = field(default_factory=lambda: np.eye(4))
    covariance_PT: Array = field(default_factory=lambda: np.zeros((6, 6)))

    def of_patches(self) -> "RelativePoseEstimate":
        """The same of the patches' frame P in place of the tool's: what loads the membranes, and so a bushing."""
        return replace(
            self, X_CT=self.X_CT @ inverse_pose(self.X_PT), covariance=self.covariance - self.covariance_PT,
            X_PT=np.eye(4), covariance_PT=np.zeros((6, 6)),
        )  # fmt: skip

    @property
    def observed_translation(self) -> tuple[bool, bool, bool]:
        """Whether x, y, z of C are seen."""
        return self.observed[0], self.observed[1], self.observed[2]

    @property
    def observed_rotation(self) -> tuple[bool, bool, bool]:
        """Whether roll, pitch, yaw are seen."""
        return self.observed[3], self.observed[4], self.observed[5]


class Regrasp:
    """Poses around the moment at which T becomes C anew: they must not be joined to those before.

    A controller that presses would take the deflection for gone and press once more. So whoever publishes relative
    poses tells none for a while: enough invalid ones to make a controller hold, for longer than it goes without a
    valid one. Neither a lost message nor a slow camera lets it miss both.

    `begin` when a new grasp or reference is asked for, `end` when it is taken or given up.
    """

    def __init__(self) -> None:
        self._reason, self._open = "", False
        self._told, self._since = 0, inf

    def begin(self, what: str) -> None:
        """From the next pose on, until `end` and some time after it. what: 'grasp' or 'reference'."""
        self._reason = f"a new {what} is taken, deflections count from it: release what is pressed, then enable again"
        self._open, self._told, self._since = True, 0, inf

    def end(self) -> None:
        """The new grasp or reference counts from now on, or there is none."""
        self._open = False

    @property
    def under_way(self) -> bool:
        """Whether poses are not to be used yet."""
        return bool(self._reason)

    def through(self, estimate: RelativePoseEstimate) -> RelativePoseEstimate:
        """What to publish in place of an estimate."""
        if not self._reason:
            return estimate
        self._since = min(self._since, estimate.stamp)
        if not self._open and self._told >= LEAST and estimate.stamp - self._since >= LASTING:
            self._reason = ""
            return estimate
        self._told += 1
        return replace(estimate, valid=False, gross_slip=False, reason=self._reason)
