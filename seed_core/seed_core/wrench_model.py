# SPDX-License-Identifier: Apache-2.0
"""What turns an estimate of the grasp into the wrench of its spring: the paper's map, or another model.

Every model says how well it knows its wrench. For the map of the tool's pose, `BushingModel`, that is

    C = J C_pose J^T + diag(s)^2,    s_i^2 = (own share x |w_i|)^2 + (coupling x |f|)^2,    torques: (lever x |f|)^2

J is the map's derivative by the pose. The own share of a component collects the identification's standard deviation of
its stiffness, what a linear map leaves of a membrane (usually, or in the identification, whichever is more), and how
far a grasp drifts after its identification.
"""

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from seed_core.bushing import Bushing, Stiffness
from seed_core.config import field
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, skew, so3_exp, so3_log

_UNOBSERVED = np.array((0.2, 0.2, 0.2, 0.01, 0.01, 0.01)) ** 2  # [rad^2, m^2] of an axis that nobody sees
_STATED_NONE = np.array((np.deg2rad(0.5),) * 3 + (3e-4,) * 3) ** 2  # of an estimate that states no covariance
_MOST_DRIFT = 0.2  # share; an older identification is not known to be worse than this


class SpringWrench(NamedTuple):
    """The spring's load on the tool about T's origin, written in T.

    Attributes:
        wrench: torque [N m] and force [N].
        covariance: (6, 6) of (torque, force): from the estimate's covariance and from the model's own uncertainty.
        reason: what makes it doubtful (beyond the identified range, say); '' otherwise.
    """

    wrench: Wrench
    covariance: Array
    reason: str = ""


class WrenchModel(Protocol):
    """A model of one grasp. One that remembers former estimates is `WithMemory`, too.

    Attributes:
        name: as `WrenchEstimate.msg` tells it: 'bushing', 'hysteretic', 'membrane'.
        stiffness: about the present deflection; the control law takes the deflection to command from it.
    """

    name: str

    @property
    def stiffness(self) -> Stiffness: ...

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        """The spring's wrench as the estimate shows it; a covariance that is not finite says that it cannot be told.

        What the tool has slid on its membranes loads nothing: a bushing tells of the patches, in their frame.
        """
        ...


@runtime_checkable
class WithMemory(Protocol):
    """What a `WrenchModel` has besides whose wrench depends on the estimates before, as hysteresis does."""

    def reset(self) -> None:
        """The tool is grasped anew."""

    def take_back(self) -> None:
        """The newest estimate was none: as if `spring` had not been told of it."""


@dataclass(frozen=True)
class MapUncertainty:
    """How far the map of one grasp may be off, beside the standard deviations of its identification."""

    residual: float = field(
        0.05,
        low=0.0,
        high=1.0,
        doc="share of each component that a linear map leaves unexplained of a soft grasp, at least",
    )
    coupling: float = field(0.01, low=0.0, high=1.0, doc="share of the force's size that shows up on the other axes")
    lever: float = field(2.0, unit="mm", low=0.0, high=50.0, doc="of the force about the centre that was identified")
    unidentified: float = field(
        0.05, low=0.0, high=1.0, doc="relative standard deviation of a stiffness whose file states none"
    )
    drift: float = field(
        0.01,
        unit="1/sqrt(day)",
        low=0.0,
        high=1.0,
        doc="relative random walk of the stiffness after that",
    )


class BushingModel:
    """The paper's map (Theorem 1) on the pose of the tool in the grasp, with its covariance.

    Attributes:
        bushing: the map in use; whoever takes over another stiffness sets it.
    """

    name = "bushing"

    def __init__(
        self,
        bushing: Bushing,
        uncertainty: MapUncertainty | None = None,
        deviations: Array | None = None,
        age: float = 0.0,
        unexplained: Array | None = None,
    ) -> None:
        """See `identified` for deviations, age and unexplained."""
        self.bushing, self._uncertainty = bushing, uncertainty or MapUncertainty()
        self.identified(deviations, age, unexplained)

    @property
    def stiffness(self) -> Stiffness:
        """Of the map; the same everywhere."""
        return self.bushing.stiffness

    def identified(self, deviations: Array | None = None, age: float = 0.0, unexplained: Array | None = None) -> None:
        """Tell of the identification.

        Args:
            deviations: (6,) relative standard deviations of [rotation, translation]; None where none are stated.
            age: [days] since it was made.
            unexplained: (6,) share of each component of (torque, force) that the map left of poses that the fit did not
                see; counts where it is more than `residual`. None where nobody told.
        """
        u = self._uncertainty
        stated = np.full(6, u.unidentified) if deviations is None else np.asarray(deviations, dtype=float)
        drift = min(u.drift * sqrt(max(age, 0.0)), _MOST_DRIFT)
        left = np.maximum(u.residual, 0.0 if unexplained is None else np.asarray(unexplained, dtype=float))
        self._own = stated**2 + left**2 + drift**2  # variance of each share

    def spring(self, estimate: RelativePoseEstimate) -> SpringWrench:
        estimate = estimate.of_patches()  # what the tool has slid on its membranes loads nothing
        X_CT = observed_part(estimate)
        X_TC = inverse_pose(X_CT)
        wrench = self.bushing.wrench(X_TC)
        by_pose, by_map = self.covariances(X_TC, wrench, pose_covariance(estimate))
        return SpringWrench(wrench, by_pose + by_map)

    def covariances(self, X_TC: Array, wrench: Wrench, of_pose: Array) -> tuple[Array, Array]:
        """Covariances (6, 6) of (torque, force) by the pose, and by the map; their sum is the wrench's.

        Args:
            X_TC: (4, 4) displacement at which the map gives this wrench.
            of_pose: (6, 6) of [rotation vector in C, translation in C], see `pose_covariance`.
        """
        J, u = self._derivative(X_TC, wrench), self._uncertainty
        w = wrench.vector()
        size = float(wrench.force @ wrench.force)
        across = np.full(6, u.coupling**2 * size)
        across[:3] = (1e-3 * u.lever) ** 2 * size
        return J @ of_pose @ J.T, np.diag(self._own * w * w + across)

    def _derivative(self, X_TC: Array, wrench: Wrench) -> Array:
        """(6, 6) of [torque, force] in T by [rotation vector in C, translation in C], to first order of the deflection.

        Turning the tool by w in C turns C in T by -R_TC w, about T's origin.
        """
        R, lever = X_TC[:3, :3], skew(X_TC[:3, 3])
        R_TB = so3_exp(0.5 * so3_log(R))
        J = np.zeros((6, 6))
        J[:3, :3] = -((R_TB * self.bushing.k) @ R_TB.T @ R)
        p_by_turn = lever @ R  # p_TC by w
        if self.bushing.model == "plain":
            J[3:, :3], J[3:, 3:] = self.bushing.K[:, None] * p_by_turn, -self.bushing.K[:, None] * R
            return J
        K, load = (R_TB * self.bushing.K) @ R_TB.T, skew(wrench.force)
        J[3:, :3] = 0.5 * (K @ p_by_turn + load @ R)  # the axes in which K is diagonal turn by half
        J[3:, 3:] = -(K @ R)
        J[:3] += 0.5 * (lever @ J[3:])
        J[:3, :3] -= 0.5 * (load @ p_by_turn)
        J[:3, 3:] += 0.5 * (load @ R)
        return J


def observed_part(estimate: RelativePoseEstimate) -> Array:
    """X_CT (4, 4) with the tool where it was grasped on every axis that the estimate does not observe.

    What an estimator says of such an axis may have the wrong sign, and fed forward it would run away.
    """
    if all(estimate.observed):
        return estimate.X_CT
    turn = np.where(estimate.observed_rotation, so3_log(estimate.X_CT[:3, :3]), 0.0)
    return make_pose(so3_exp(turn), np.where(estimate.observed_translation, estimate.X_CT[:3, 3], 0.0))


def pose_covariance(estimate: RelativePoseEstimate, default: Array = _STATED_NONE) -> Array:
    """(6, 6) of [rotation vector in C, translation in C]: as stated, where stated, and wide where nothing is observed.

    default: (6,) variances of an estimate that states none.
    """
    C = estimate.covariance
    if not C.any():
        C = np.diag(default)
    if all(estimate.observed):
        return C
    unseen = ~np.array(estimate.observed_rotation + estimate.observed_translation)
    C = np.where(unseen[:, None] | unseen[None, :], 0.0, C)
    C[unseen, unseen] = _UNOBSERVED[unseen]
    return C
