# SPDX-License-Identifier: Apache-2.0
"""Between widths and forces of fingers and the goals of a gripper's action server, whose joint may be an angle."""

from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import NamedTuple

from seed_core.config import ConfigError, field
from seed_core.errors import SeedError

AGAIN = 1.0  # [s] after which a goal that has failed is sent again


class GripperError(SeedError):
    """A command that no gripper can carry out."""


@dataclass(frozen=True)
class GripperActionConfig:
    """One parallel gripper behind control_msgs/GripperCommand or control_msgs/ParallelGripperCommand."""

    action: str = field("gripper_controller/gripper_cmd", doc="name of the action")
    kind: str = field(
        "GripperCommand", choices=("GripperCommand", "ParallelGripperCommand"), doc="its type, of control_msgs"
    )
    joint: str = field("gripper_joint", doc="name of the joint in joint_states and in the goals")
    open_width: float = field(0.085, unit="m", low=0.001, high=1.0, doc="distance of the open fingers")
    open_position: float = field(0.085, low=-10.0, high=10.0, doc="of the joint there [m or rad]")
    closed_width: float = field(
        0.0, unit="m", low=0.0, high=1.0, doc="distance of the closed fingers; above 0 where they cannot meet"
    )
    closed_position: float = field(0.0, low=-10.0, high=10.0, doc="of the joint there [m or rad]; forces close to it")
    max_force: float = field(20.0, unit="N", low=0.1, high=500.0, doc="of each finger, with commands of width")
    effort_per_force: float = field(1.0, low=1e-3, high=1e3, doc="the action's effort per newton of one finger")
    force: str = field(
        "measured",
        choices=("measured", "commanded"),
        doc="what gripper/force tells: the joint's effort, or what was asked for once the server says it has stalled",
    )
    rate: float = field(20.0, unit="Hz", low=1.0, high=200.0, doc="of goals, at most")
    least_width: float = field(2e-4, unit="m", low=0.0, high=0.01, doc="smaller changes of width send no goal")
    least_force: float = field(0.2, unit="N", low=0.0, high=10.0, doc="smaller changes of force send no goal")

    def __post_init__(self) -> None:
        if self.open_position == self.closed_position:
            raise ConfigError(f"open_position and closed_position are both {self.open_position:g}: they must differ")
        if self.closed_width >= self.open_width:
            raise ConfigError(
                f"closed_width = {self.closed_width:g} m must be less than open_width = {self.open_width:g} m"
            )

    @property
    def width_per_position(self) -> float:
        """[m] by [m or rad] of the joint; negative where the joint runs the other way."""
        return (self.open_width - self.closed_width) / (self.open_position - self.closed_position)


class Goal(NamedTuple):
    """What an action server is sent: joint position [m or rad] and effort; force: [N] of each finger that it means."""

    position: float
    effort: float
    force: float


class GripperGoals:
    """Which goal to send, and what joint and server say of the fingers. Time is an argument.

    Attributes:
        settled: [N] push of each finger as the end of the newest goal tells it; not a number for unknown, as from a new
            width until that goal ends. After a new force for the same width the former push is told until then.
    """

    def __init__(self, config: GripperActionConfig) -> None:
        self.config = config
        self._wanted: Goal | None = None
        self._sent: Goal | None = None
        self._when, self._pause = -inf, 0.0  # [s] of the newest goal, or of its failure, and until the next
        self.settled = nan

    def width(self, width: float) -> None:
        """The fingers are to go to a width [m], and push with no more than max_force. Raises GripperError."""
        c = self.config
        if not isfinite(width) or not c.closed_width <= width <= c.open_width:
            least = f"closed_width = {c.closed_width:g}" if c.closed_width else "0"
            raise GripperError(
                f"gripper/command = {width} m must be between {least} and open_width = {c.open_width:g} m"
            )
        self._wanted = self._goal(width, c.max_force)

    def push(self, force: float) -> None:
        """Each finger is to push with a force [N]. Raises GripperError.

        An effort of 0 is no force to ask for. Servers take it for their greatest (ZebraDevs/robot_controllers,
        parallel_gripper.cpp), for their default (OnRobot/onrobot-ros2, onrobot_gripper_controllers), or for fingers
        without torque, which drop the tool (SAKErobotics/EZGripper_ros2, ezgripper_action_server.py).
        """
        c = self.config
        if not isfinite(force) or not 0.0 < force <= c.max_force:
            raise GripperError(
                f"gripper/force_command = {force} N must be above 0 and at most max_force = {c.max_force:g} N; "
                "fingers that are not to push are opened by gripper/command"
            )
        self._wanted = self._goal(c.closed_width, force)

    def _goal(self, width: float, force: float) -> Goal:
        c = self.config
        position = c.closed_position + (width - c.closed_width) / c.width_per_position
        return Goal(position, force * c.effort_per_force, force)

    def due(self, t: float) -> Goal | None:
        """The goal to send at t [s]; None where there is nothing new."""
        c, new, old = self.config, self._wanted, self._sent
        if new is None or new == old or 0.0 <= t - self._when < self._pause:
            return None
        if old is not None:
            moved = abs((new.position - old.position) * c.width_per_position)
            if moved < c.least_width and abs(new.force - old.force) < c.least_force:
                return None
        if old is None or new.position != old.position:
            self.settled = nan
        self._sent, self._when, self._pause = new, t, 1.0 / c.rate
        return new

    def refused(self) -> None:
        """The server did not accept the newest goal: it is sent again."""
        self._sent = None

    def forget(self) -> bool:
        """No server is there: one that comes later gets new commands only. Whether one was waiting or carried out."""
        known = self._wanted is not None
        self._wanted, self._sent, self.settled = None, None, nan
        return known

    def ended(self, goal: Goal, stalled: bool, reached: bool, t: float) -> bool:
        """How a goal has ended, at t [s]. Fingers that stall push as asked for; those that arrive may push on nothing.

        Returns:
            Whether the newest has failed: neither stalled nor arrived, though nothing of ours took its place. It is
            sent again after a pause.
        """
        if goal is not self._sent:
            return False
        if stalled or reached:
            self.settled = goal.force if stalled else 0.0
            return False
        self._sent, self._when, self._pause = None, t, AGAIN
        return True

    def width_of(self, position: float) -> float:
        """Distance of the fingers [m] where the joint is at a position [m or rad]."""
        c = self.config
        return c.closed_width + (position - c.closed_position) * c.width_per_position

    def force_of(self, effort: float) -> float:
        """Push of each finger [N] at a joint's effort; not a number for one that is not told."""
        return abs(effort) / self.config.effort_per_force if isfinite(effort) else nan
