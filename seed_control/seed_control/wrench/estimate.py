# SPDX-License-Identifier: Apache-2.0
"""The wrench of the tool on the environment, from one image that has met the kinematics of its own moment."""

from math import exp, inf
from typing import NamedTuple, Protocol

import numpy as np

from seed_control.wrench.stiffness_schedule import StiffnessBlend
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import UPRIGHT, Tool, weight_about_T
from seed_core.spatial import Array, Wrench, inverse_pose, length, make_pose, wrench_adjoint
from seed_core.vector3 import Vector3
from seed_core.wrench_model import BushingModel, SpringWrench, WithMemory, WrenchModel, observed_part, pose_covariance

ROTATION_DEVIATION = float(np.deg2rad(0.5))  # [rad] of an estimate that states no covariance
MOST_DISCREPANCY = 0.7  # share of the bushing's load by which a model's may differ for the law
FOLLOWING = 0.3  # [s] in which the law takes over a model's local stiffness
_WORTHWHILE = 0.005  # relative change of a stiffness that is followed
_LEAST_LEVER = 0.01  # [m]
_FLOOR = (1.0, 0.05)  # [N], [N m] by which it may differ near rest


class Measurement(NamedTuple):
    """Poses at the image's stamp; frames as in the notation.

    Attributes:
        tip: (3,) [m] in W. undeflected: (3,) the same if T's origin were at C's, with the tool's rotation as it is.
        spring: the bushing's load on the tool about T's origin, in T, at this displacement.
        on_environment: the tool's load on the environment about the tip, in W, as the wrench model tells it.
        model_spring: the spring's load as the wrench model has it, before any correction; on_environment is after it.
        discrepancy: bushing less model, on the tool about T's origin, in T; None where the model is the bushing.
        spring_covariance: (6, 6) of the model's (torque, force) on the tool, in T; None: `WrenchEstimator.covariance`
            works it out from the estimate.
        doubt: what the model finds doubtful of its wrench; '' otherwise.
        variance: of a position component of X_CT [m^2].
        rotation_deviation: standard deviation of a rotation component of X_CT [rad].
    """

    stamp: float
    X_WC: Array
    X_WT: Array
    X_TC: Array
    X_CT: Array
    tip: Array
    undeflected: Array
    spring: Wrench
    on_environment: Wrench
    variance: float
    rotation_deviation: float
    model_spring: Wrench
    discrepancy: Wrench | None = None
    spring_covariance: Array | None = None
    estimate: RelativePoseEstimate | None = None
    doubt: str = ""


class WrenchCorrection(Protocol):
    """What other knowledge adds to a model's wrench."""

    active: bool

    def wrench(self, told: Wrench) -> Wrench | None:
        """On the tool about T's origin, in T; None for nothing."""

    def mismatch(self, told: Array) -> tuple[Array, Array]:
        """What the model is off by (6,) of (torque, force), with covariance (6, 6)."""

    def rescale(self, ratio: Array) -> None:
        """The model tells ratio (3,) times as much force along x, y and z of T from now on."""


class WrenchEstimator:
    """Estimates to measurements by a wrench model, for one tool and a stiffness that may change.

    The law commands deflections of a bushing. Where the wrench comes from another model, that bushing has the model's
    local stiffness, and what the two differ by at the measured deflection is the measurement's `discrepancy`.

    Attributes:
        model: what the wrench comes from. bushing: the map in use. correction: of the model's wrench, or None.
        p_Ttip: (3,) [m].
    """

    def __init__(
        self,
        tool: Tool,
        bushing: Bushing,
        gravity: bool,
        default_deviation: float,
        model: WrenchModel | None = None,
        up: Vector3 = UPRIGHT,
    ) -> None:
        """Start with a bushing.

        Args:
            default_deviation: [m] of a position of an estimate that states no covariance.
            model: of the wrench; None: the bushing itself. A BushingModel takes over this bushing.
            up: against gravity, in W.
        """
        self.tool, self.bushing, self.up = tool, bushing, np.array(up)
        self.correction: WrenchCorrection | None = None
        self._told: tuple[RelativePoseEstimate | None, SpringWrench | None] = None, None
        self._followed = -inf  # [s]
        self._of_bushing: BushingModel | None = None
        self.model: WrenchModel
        if model is None or isinstance(model, BushingModel):
            self.model = self._of_bushing = model or BushingModel(bushing)
            self._of_bushing.bushing = bushing
        else:
            self.model, self.bushing = model, Bushing(model.stiffness, bushing.model)
        self.p_Ttip = tool.X_Ttip[:3, 3].copy()
        self._blend: StiffnessBlend | None = None
        self._mass, self._com = tool.mass if gravity else 0.0, np.array(tool.center_of_mass)
        self._default_variance = default_deviation**2
        self._default_variances = np.array((ROTATION_DEVIATION**2,) * 3 + (self._default_variance,) * 3)

    @property
    def mean_stiffness(self) -> float:
        """Of the three translations [N/m]."""
        return sum(self.bushing.stiffness.translation) / 3.0

    @property
    def turning_stiffness(self) -> float:
        """Force at the tip that turns the grasp about its softest axis [N/rad]."""
        lever = length(self.p_Ttip)
        return min(self.bushing.stiffness.rotation) / max(lever, _LEAST_LEVER)

    def set_stiffness(self, stiffness: Stiffness, t: float, duration: float) -> bool:
        """Take over another stiffness from time t [s] on, within duration [s]. False: the model has one of its own."""
        if self._of_bushing is None:
            return False
        self._blend = StiffnessBlend(self.bushing.stiffness, stiffness, t, duration)
        if duration == 0.0:
            self.advance(t)
        return True

    def advance(self, t: float) -> None:
        """Go on with taking over a stiffness, if one is being taken over."""
        blend = self._blend
        if blend is None:
            return
        if t < blend.start:  # the clock was set back: on from what is in use
            blend = self._blend = StiffnessBlend(self.bushing.stiffness, blend.new, t, blend.duration)
        former, self.bushing = self.bushing, Bushing(blend.at(t), self.bushing.model)
        if self._of_bushing is not None:
            self._of_bushing.bushing = self.bushing
        if self.correction is not None:
            self.correction.rescale(self.bushing.K / former.K)
        if blend.share(t) >= 1.0:
            self._blend = None

    def weight(self, R_WT: Array) -> Wrench:
        """Weight about T's origin in T, of the tool at R_WT (3, 3); zero for a law without gravity."""
        return weight_about_T(self._mass, self._com, R_WT, self.up)

    def true_weight(self, R_WT: Array) -> Wrench:
        """The same whatever the law."""
        return weight_about_T(self.tool.mass, self._com, R_WT, self.up)

    def why_unknown(self, estimate: RelativePoseEstimate) -> str:
        """Why the model cannot tell the wrench of a valid estimate; '' if it can."""
        if self._of_bushing is not None or not (estimate.valid and np.isfinite(estimate.X_CT).all()):
            return ""
        told = self.model.spring(estimate)
        self._told = estimate, told
        if np.isfinite(told.wrench.vector()).all() and np.isfinite(told.covariance).all():
            return ""
        why = told.reason or "its wrench is not finite"
        return f"the wrench model '{self.model.name}' cannot tell the wrench (estimate by '{estimate.method}'): {why}"

    def refused(self, estimate: RelativePoseEstimate) -> None:
        """An estimate is not used: it leaves nothing in the memory of a model that has one."""
        if isinstance(self.model, WithMemory) and self._told[0] is estimate:
            self.model.take_back()

    def new_grasp(self) -> None:
        """A model with a memory (of hysteresis, say) begins anew."""
        if isinstance(self.model, WithMemory):
            self.model.reset()

    def _follow_stiffness(self, stamp: float) -> None:
        """Let the law's bushing come to the model's local stiffness, without a jump."""
        dt, self._followed = stamp - self._followed, stamp
        local, used = self.model.stiffness.vector(), self.bushing.stiffness.vector()
        if np.abs(local / used - 1.0).max() > _WORTHWHILE:
            mixed = used + low_pass_share(dt, FOLLOWING) * (local - used)
            self.bushing = Bushing(Stiffness.from_vector(mixed), self.bushing.model)

    def measure(self, estimate: RelativePoseEstimate, X_WC: Array) -> Measurement:
        """The measurement of one estimate, the gripper having been at X_WC (4, 4) at its stamp."""
        X_CT = observed_part(estimate)
        X_WT, X_TC = X_WC @ X_CT, inverse_pose(X_CT)
        R_WT = X_WT[:3, :3]
        lever = R_WT @ self.p_Ttip
        spring = told = self.bushing.wrench(X_TC)
        discrepancy, covariance, doubt = None, None, ""
        if self._of_bushing is None:
            of, result = self._told
            told, covariance, doubt = result if of is estimate and result is not None else self.model.spring(estimate)
            self._follow_stiffness(estimate.stamp)
            spring = self.bushing.wrench(X_TC)
            discrepancy = bounded(spring.minus(told), spring)
        corrected = told
        if self.correction is not None and (more := self.correction.wrench(told)) is not None:
            corrected = told.plus(more)
            discrepancy = bounded(spring.minus(corrected), spring)
        stated, seen = estimate.covariance.diagonal(), estimate.observed_translation
        of_force = stated[3:][list(seen)] if any(seen) and not all(seen) else stated[3:]  # it is controlled along these
        turning = sum(stated[:3].tolist()) / 3.0
        variance = float(np.mean(of_force))
        return Measurement(
            stamp=estimate.stamp,
            X_WC=X_WC,
            X_WT=X_WT,
            X_TC=X_TC,
            X_CT=X_CT,
            tip=X_WT[:3, 3] + lever,
            undeflected=X_WC[:3, 3] + lever,
            spring=spring,
            on_environment=corrected.plus(self.weight(R_WT)).about(self.p_Ttip).rotated(R_WT),
            variance=max(variance, 1e-10) if variance > 0.0 else self._default_variance,
            rotation_deviation=turning**0.5 if turning > 0.0 else ROTATION_DEVIATION,
            model_spring=told,
            discrepancy=discrepancy,
            spring_covariance=covariance,
            estimate=estimate,
            doubt=doubt,
        )

    def covariance(self, m: Measurement) -> tuple[Array, Array]:
        """Two covariances (6, 6) of (torque, force).

        Returns:
            Of the tool's wrench `on_environment`, about the tip in W; and of the spring's in T by the pose alone, where
            the model is the bushing, else the model's.
        """
        if self._of_bushing is not None:
            assert m.estimate is not None
            of_pose = pose_covariance(m.estimate, self._default_variances)
            by_pose, by_map = self._of_bushing.covariances(m.X_TC, m.spring, of_pose)
        else:
            assert m.spring_covariance is not None
            by_pose, by_map = m.spring_covariance, np.zeros((6, 6))
        C = by_pose + by_map
        if self.correction is not None and self.correction.active:
            C = by_pose + self.correction.mismatch(m.model_spring.vector())[1]
        R = m.X_WT[:3, :3]
        A = wrench_adjoint(make_pose(R, -R @ self.p_Ttip))
        return A @ C @ A.T, by_pose


def low_pass_share(dt: float, tau: float) -> float:
    """Weight of a new sample in a first-order low-pass of time constant tau [s] after dt [s]."""
    return 1.0 - exp(-max(dt, 0.0) / tau) if tau > 0.0 else 1.0  # stamps may be set back


def bounded(discrepancy: Wrench, spring: Wrench) -> Wrench:
    """The discrepancy between bushing and model, no larger than a loop endures that trusts the bushing's stiffness.

    The command answers a share of the deflection with that share of more deflection: below one it settles.
    """
    size = length(discrepancy.force)
    bound = MOST_DISCREPANCY * length(spring.force) + _FLOOR[0]
    turning = length(discrepancy.torque)
    torque_bound = MOST_DISCREPANCY * length(spring.torque) + _FLOOR[1]
    return Wrench(
        discrepancy.torque * min(torque_bound / max(turning, 1e-12), 1.0),
        discrepancy.force * min(bound / max(size, 1e-12), 1.0),
    )
