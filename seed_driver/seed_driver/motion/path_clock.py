# SPDX-License-Identifier: Apache-2.0
"""The clock of the path: the robot's own time, scaled as the robot scales it, so that the command never runs ahead.

A robot at 10 % (speed slider of the pendant, limits of its safety) takes ten times as long for servoj as it is asked
to. A command that goes on by the wall's time is soon centimetres away, and the arm jumps there when the slider rises.
"""

AHEAD = 2  # steps of motion beyond the newest state of the robot
STANDSTILL = 0.002  # a robot scaled to less stands still


class PathClock:
    """How much of the path may pass in each cycle.

    Attributes:
        scale: of the robot's time, in its newest state; 0..1.
    """

    def __init__(self) -> None:
        self.restart(0.0, 1.0)

    def restart(self, clock: float, scale: float) -> None:
        """The command stands where the arm stands, at the robot's clock [s] and scale."""
        self.scale = min(1.0, max(0.0, scale))
        self._clock = clock
        self._robot = self._made = 0.0  # [s] of the path that the robot had time for, and that was commanded
        self._share = self.scale

    def heard(self, clock: float, scale: float) -> bool:
        """A new state of the robot; True when it has just come out of a standstill."""
        scale = min(1.0, max(0.0, scale))
        self._robot += min(scale, self.scale) * max(0.0, clock - self._clock)
        stood = self.scale < STANDSTILL <= scale
        self._clock, self.scale = clock, scale
        return stood

    def share(self, dt: float, rise: float) -> float:
        """Share of a cycle of dt [s] by which the command may go on: never far ahead of the robot, nothing caught up.

        What is sent to a robot that is not heard may wait somewhere and reach it all at once, as one long step; and
        what it could not follow at a low scale it makes up for at once at a high one.

        Args:
            rise: [1/s] fastest growth of the share; it falls at once.
        """
        self._share = min(self.scale, self._share + rise * dt)
        if self._share < STANDSTILL:
            return 0.0
        step = self._share * dt
        until = max(self._made, self._robot) + step
        if until > self._robot + (AHEAD + 0.5) * step:
            return 0.0
        self._made = until
        return self._share
