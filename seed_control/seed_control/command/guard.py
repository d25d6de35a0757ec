# SPDX-License-Identifier: Apache-2.0
"""Whether the arm may move: it is enabled, and nothing has made it hold since."""

from math import degrees, inf

from seed_control.command.arm_follows import ArmFollows, Behind
from seed_control.command.displacement_travel import DisplacementTravel, Stopping
from seed_control.command.free_travel import FreeTravel
from seed_control.law.published import Plan
from seed_control.parameters import ControllerParameters
from seed_control.state import EventLog
from seed_control.wrench.estimate import Measurement
from seed_core.arm.hold import HoldLatch
from seed_core.spatial import length, rpy_from_rotation
from seed_core.vector3 import Vector3, as_vector3

_IMAGES = 3  # in a row that must agree on an overload
_AGO = 1.0  # [s] for which it knows the way back to where nothing was in the way
_TURNED = 1.0  # [s] for which torques may want the gripper turned further than it may be
_SWAYS = 0.5  # of the tool's weight, that it presses with as the arm starts and stops


class Guard:
    """Enabled or not, and the latched hold, with what trips it while the arm moves.

    Attributes:
        enabled: since `enable`, until `disable`.
        free_travel: how far the arm has gone without the force that is wanted.
        displacement_travel: the same without the displacement of the grasp that is wanted.
        back_to: place of C [m] where nothing was in the way, of a hold for what is; None: of none.
    """

    def __init__(
        self, parameters: ControllerParameters, events: EventLog, stopping: Stopping, turning: Stopping
    ) -> None:
        """stopping, turning: the way [m], [rad] in which the command comes to rest from a speed [m/s], [rad/s]."""
        self.parameters, self._events = parameters, events
        self._latch = HoldLatch(inf)
        self.enabled = False
        self._too_far = self._pressed = 0  # images in a row
        self._directions, self._least_across = 0, inf  # [N] across the force directions, the least since they are so
        # Stamp [s] and place of C [m] of the last image that showed less than half of too much.
        self._free: tuple[float, Vector3] | None = None
        self.back_to: Vector3 | None = None
        self._turned_at: float | None = None  # stamp [s] since which torques want it turned further than it may be
        self.free_travel = FreeTravel(parameters.max_free_travel, stopping)
        self.displacement_travel = DisplacementTravel(
            parameters.max_free_travel, parameters.max_drift, stopping, turning
        )
        self._arm = ArmFollows(parameters.max_tracking_error, parameters.max_angular_tracking_error)

    @property
    def held(self) -> str:
        """Why it holds; empty while it does not."""
        return self._latch.reason

    @property
    def following(self) -> bool:
        """Whether set-points are followed."""
        return self.enabled and not self._latch.reason

    def enable(self, on: bool, remark: str = "") -> None:
        """Allow motion or not; either way a hold is over."""
        self._latch.resume()
        self.enabled = on
        self._events.restart(remark)
        self._pressed = 0
        if not self._directions:  # away from what was in the way
            self._least_across = inf
        self._free = self.back_to = self._turned_at = None
        self.free_travel.restart()
        self.displacement_travel.restart()
        self._arm.restart()

    def hold(self, why: str) -> None:
        """Stop, if it moves and there is a reason: '' is none. The first one stays."""
        if why and self.following:
            self._latch.hold(why)
            self._events.count("holds")

    def check_overload(self, m: Measurement) -> None:
        """Per image: hold when the grasp is deflected or loaded beyond what it endures, in three images in a row."""
        p = self.parameters
        force = length(m.on_environment.force)
        deflection = length(m.X_TC[:3, 3])
        angle = degrees(max(map(abs, rpy_from_rotation(m.X_TC[:3, :3]).tolist())))
        why = (
            f"estimated force {force:.1f} N is beyond {p.max_measured_force:g} N"
            if force > p.max_measured_force
            else f"deflection {1e3 * deflection:.1f} mm is beyond {1.2e3 * p.max_deflection:.1f} mm: the tool may slip"
            if deflection > 1.2 * p.max_deflection
            else f"rotation {angle:.0f} degrees in the grasp is beyond {1.2 * p.max_rotation:.0f}: the tool may slip"
            if angle > 1.2 * p.max_rotation
            else ""
        )
        self._too_far = self._too_far + 1 if why else 0
        if self._too_far >= _IMAGES and self.enabled:
            self.hold(why)

    def check_unexpected(self, m: Measurement, plan: Plan, weight: float) -> None:
        """Per image: hold when the tool is pressed where no force is wanted, harder than it was, in three in a row.

        Friction makes force across the wanted one, a heavy tool (weight [N]) when the arm starts.
        """
        force = m.on_environment.force
        N = plan.normals if plan.wanted.any() else plan.normals[:0]  # a force of zero allows none along it
        across = force - N.T @ (N @ force)
        size = length(across)
        if len(N) != self._directions:
            self._directions, self._least_across = len(N), inf
        self._least_across = min(self._least_across, size)
        wanted, most = length(plan.wanted), self.parameters.max_unexpected_force
        rise = size - self._least_across
        bound = most + wanted + _SWAYS * weight
        self._pressed = self._pressed + 1 if rise > bound else 0
        if rise < 0.5 * bound:
            self._free = m.stamp, as_vector3(m.X_WC[:3, 3])
        if self._pressed >= _IMAGES and self.following:
            if not len(N) and self._free is not None and m.stamp - self._free[0] < _AGO:
                self.back_to = self._free[1]
            self.hold(
                f"the tool is pressed with {rise:.1f} N where no force is wanted, beyond max_unexpected_force = "
                f"{most:g} N: something is in its way; move it off, or control the force there"
            )

    def check_turn(self, m: Measurement, plan: Plan) -> None:
        """Per image: hold when torques have wanted the gripper turned further than it may be for a while."""
        if "max_drift" not in plan.limits:
            self._turned_at = None
            return
        self._turned_at = m.stamp if self._turned_at is None else self._turned_at
        if m.stamp - self._turned_at > _TURNED:
            p = self.parameters
            self.hold(
                f"the torque would turn the gripper on, {p.max_rotation + p.max_drift:g} degrees from its reference "
                "(max_rotation + max_drift): the contact does not resist about the torque axes; hold these in angle, "
                "or press a wider contact"
            )

    def check_motion(self, p_WC: Vector3, plan: Plan, behind: Behind, dt: float, own: bool = True) -> None:
        """Per step of dt [s]: hold when an approach goes too far, or the arm does not follow.

        Args:
            p_WC: commanded position [m]; behind: where the arm is.
            own: where no force is wanted it goes to a place that was asked for, not to a displacement of the grasp.
        """
        self.hold(self.free_travel.step(p_WC, plan.normals[plan.wanted != 0.0], dt, own))
        self.hold(self._arm.update(behind, dt))
