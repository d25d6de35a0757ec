# SPDX-License-Identifier: Apache-2.0
"""Whether a relative pose can be what the cameras see now: it is not frozen, and has not jumped."""

from math import degrees, inf

from seed_control.parameters import ControllerParameters
from seed_control.wrench.estimate import Measurement
from seed_control.wrench.history import PoseHistory
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, length, so3_log

_MOVED = 5e-4, 3e-3  # [m], [rad]: so far the arm goes before a pose must differ in its last bits
_TOLD = 7.0  # deviations of a component, from which on a jump is told
_LONG = 0.5  # [s] of poses that are the same, which is told
_NOISE = 8.5  # deviations of a component (six of a difference) that a jump stands out by


class FrozenPoseCheck:
    """Whether the poses are those of one image, told again and again with fresh stamps.

    Attributes:
        warning: for how long they have been the same, where nothing has moved; '' for not long.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """What was seen is over."""
        self.warning, self._since = "", inf
        self._from: Array | None = None  # flange pose at the first of the poses that are the same

    def check(self, estimate: RelativePoseEstimate, last: RelativePoseEstimate | None, history: PoseHistory) -> str:
        """Why an estimate cannot be new; '' if it can.

        It is the last one (of the good ones) bit by bit, though the arm has moved since the first that was so: by
        whole millimetres or by many small steps.
        """
        if last is None or estimate.X_CT.tolist() != last.X_CT.tolist():
            self.restart()
            return ""
        self._since = min(self._since, last.stamp)
        if self._from is None:  # the history may begin after the first that was so
            self._from = history.at(last.stamp)
        if estimate.stamp - self._since > _LONG:
            self.warning = (
                f"the pose in the grasp is the same to the last bit for {estimate.stamp - self._since:.1f} s: see "
                "whether the cameras still send"
            )
        now = history.at(estimate.stamp)
        if self._from is None or now is None:
            return ""
        way, turn = now[:3, 3] - self._from[:3, 3], length(so3_log(self._from[:3, :3].T @ now[:3, :3]))
        moved = float(way @ way) ** 0.5
        if moved <= _MOVED[0] and turn <= _MOVED[1]:
            return ""
        return (
            f"estimate is frozen: the pose is the same to the last bit though the arm has moved by {1e3 * moved:.1f} "
            f"mm and {degrees(turn):.1f} degrees: restart the estimator, or see whether the cameras still send"
        )


class PoseJumpCheck:
    """Whether each estimate goes on from the one before.

    In contact the deflection goes no further than the gripper, in free air it stays. What jumps is a contact that is
    lost at once, a slide, or a wrong pose, none of which force may be controlled with; a small jump may be a step of
    the surface, and is told. A pose that stays where one has just jumped to is the same jump: time does not mend it.

    Attributes:
        parameters: in use; their limits may change.
        warning: the largest jump since it was enabled that does not hold; '' for none. newest: of the newest estimate.
    """

    def __init__(self, parameters: ControllerParameters) -> None:
        self.parameters = parameters
        self.restart()

    def restart(self) -> None:
        """What was seen is over."""
        self.warning, self.newest, self._largest = "", "", 0.0
        self._to: tuple[Array, tuple[float, float]] | None = None  # pose that was jumped to; [m], [rad] allowed then

    def check(
        self, estimate: RelativePoseEstimate, m: Measurement, history: PoseHistory, stiffness: float, turning: float
    ) -> str:
        """Why an estimate does not go on from the newest measurement; '' if it does.

        Args:
            history: of the flange. stiffness: of the grasp [N/m].
            turning: force at the tip that turns the grasp [N/rad].
        """
        p, noise, self.newest = self.parameters, m.variance**0.5, ""
        size = length(estimate.X_CT[:3, 3] - m.X_CT[:3, 3])
        turn = length(so3_log(m.X_CT[:3, :3].T @ estimate.X_CT[:3, :3]))
        bounds = max(p.max_jump / stiffness, _NOISE * noise), max(p.max_jump / turning, _NOISE * m.rotation_deviation)
        dt = max(estimate.stamp - m.stamp, 0.0)
        moved, turned = p.max_speed * dt, p.max_angular_speed * dt
        before, now = history.at(m.stamp), history.at(estimate.stamp)
        if before is not None and now is not None:
            moved = length(now[:3, 3] - before[:3, 3])
            turned = length(so3_log(before[:3, :3].T @ now[:3, :3]))
        moved, turned = max(moved, p.press_speed * dt), max(turned, p.max_angular_speed * dt)
        most = bounds[0] + moved, bounds[1] + turned
        if self._to is not None and _share(estimate.X_CT, *self._to) < max(size / most[0], turn / most[1]):
            most = self._to[1]
        if size <= most[0] and turn <= most[1]:
            self._to = None
            self._tell(size - moved, noise, stiffness)
            return ""
        self._to = self._to or (estimate.X_CT, most)
        return (
            f"the tool's pose has jumped by {1e3 * size:.1f} mm and {degrees(turn):.1f} degrees (at most "
            f"{1e3 * most[0]:.1f} and {degrees(most[1]):.1f}): contact was lost at once, the tool has slid, or the "
            "estimate is wrong"
        )

    def _tell(self, size: float, noise: float, stiffness: float) -> None:
        """A jump of so many metres, beyond what the motion explains."""
        if size <= _TOLD * noise:
            return
        self.newest = (
            f"the tool's pose has jumped by {1e3 * size:.1f} mm: if the surface has no such step, forces are off "
            f"by {size * stiffness:.1f} N"
        )
        if size > self._largest:
            self._largest, self.warning = size, self.newest


def _share(X_CT: Array, other: Array, most: tuple[float, float]) -> float:
    """How far a pose (4, 4) is from another, by the larger share of these bounds [m], [rad]."""
    turn = length(so3_log(other[:3, :3].T @ X_CT[:3, :3]))
    return max(length(X_CT[:3, 3] - other[:3, 3]) / most[0], turn / most[1])
