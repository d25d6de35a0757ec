# SPDX-License-Identifier: Apache-2.0
"""The plant's time: tied to the wall's, or to the clock of a stand-in UR controller whose arm carries the gripper.

Where this machine is too busy to run other processes in time, the plant stands still for them.
"""

from collections.abc import Sequence

from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_sim.plant.arm import ELBOW_UP
from seed_sim.plant.late_stream import LONGEST, LateStream
from seed_sim.plant.plant import Plant
from seed_sim.plant.tool_holder import ToolHolder
from seed_ur.plant_link import ArmState, PlantLink

BEHIND = 0.02  # [s] of wall time that the plant catches up on; what is beyond is lost and lowers the real-time factor
ROBOT_BEHIND = 0.1  # [s] the same, of the time of a stand-in controller; one that is back by more began anew
AHEAD = 1.0  # [periods] that a stand-in controller may be ahead of the plant, which follows it
PATIENCE = {"target_frame": 0.05, "relative_pose": 0.13}  # [s] age, from which the plant waits for the next
ROBOT_PATIENCE = {"target_frame": 0.012, "current_pose": 0.012, "relative_pose": 0.1}  # [s] with a robot's own lag
LONG = {"relative_pose": 15.0}  # [s] of waiting; a disk may hold an estimator up, and poses end only with it


class PlantTime:
    """`advance` moves the plant on to the present. All times are [s].

    Attributes:
        streams: what the plant waits for when it is late, by topic.
        lost: [s] of wall time in which the plant did not move.
        factor: the real-time factor, simulated over wall time, between the last two calls of `measure`.
    """

    def __init__(
        self, plant: Plant, holder: ToolHolder, robot: PlantLink | None, clock: bool, steady: float, now: float
    ) -> None:
        """Start now.

        Args:
            robot: stand-in controller that moves the arm; None: the plant's own arm.
            clock: the plant's time is everybody's, and stands still for late streams.
            steady, now: the present by the machine's steady clock and in ROS time [s].
        """
        self._plant, self._holder, self._robot, self._clock = plant, holder, robot, clock
        self._q: Sequence[float] | Array = ELBOW_UP  # [rad] of the stand-in's arm, when it was heard last
        self.factor = 1.0
        self.restart(steady, now)

    def restart(self, steady: float, now: float) -> None:
        """Tie the plant's time, which may have gone back to zero, to the present."""
        self._steady_offset = steady - self._plant.time
        self._ros_offset = now - self._plant.time
        self._robot_offset: float | None = None
        if self._robot is not None and self._robot.clock is not None:
            self._robot_offset = self._ros_offset = self._robot.clock - self._plant.time
        self.lost = 0.0
        self._measured = (steady, self._plant.time)
        patience = PATIENCE if self._robot is None else ROBOT_PATIENCE
        self.streams = {topic: LateStream(age, LONG.get(topic, LONGEST)) for topic, age in patience.items()}

    @property
    def stamp(self) -> float:
        """ROS time of the plant's present state [s]."""
        return self._ros_offset + self._plant.time

    def advance(self, steady: float, period: float) -> str:
        """Move the plant on to the present; period: [s] until the next call.

        Returns:
            What is to be told of the stand-in controller, such as that its clock went back; mostly ''.
        """
        if self._robot is None:
            self._follow_clock(steady)
            return ""
        state = self._robot.receive()
        told = "" if state is None else self._follow_robot(self._robot, state, steady)
        load = self._plant.ft_wrench
        until = None  # how far the stand-in may run by its own clock, which then is the plant's [s]; None: as it likes
        if self._clock:
            until = self.stamp + (0.0 if self._waits(steady) else AHEAD * period)
        self._robot.report(load.force, load.torque, until)
        return told

    def measure(self, steady: float) -> bool:
        """Measure the real-time factor; whether that was possible: not when the plant's time was set back."""
        now, then = (steady, self._plant.time), self._measured
        self._measured = now
        if now[0] <= then[0] or now[1] < then[1]:
            return False
        self.factor = (now[1] - then[1]) / (now[0] - then[0])
        return True

    def _follow_clock(self, steady: float) -> None:
        """An arm of the plant's own, by the wall's time less what the plant has lost."""
        behind = steady - self._steady_offset - self._plant.time
        advance = 0.0 if self._waits(steady) else min(behind, BEHIND)
        self._lose(behind - advance)
        self._holder.advance(self._plant.time + advance)

    def _follow_robot(self, robot: PlantLink, state: ArmState, steady: float) -> str:
        """The flange goes where the stand-in's arm is, in its time; the arm feels what the tool does to it."""
        if self._robot_offset is None:
            self._robot_offset = state.time - self._plant.time
            self._lose(steady - self._steady_offset - self._plant.time)  # what passed before the first word of it
        behind = state.time - self._robot_offset - self._plant.time
        if behind < -ROBOT_BEHIND:
            return f"the clock of the stand-in controller went back by {-behind:.2f} s: {self._rejoin(robot)}"
        if behind > ROBOT_BEHIND and not self._clock:
            self._robot_offset += behind - ROBOT_BEHIND
            self._lose(behind - ROBOT_BEHIND)
            behind = ROBOT_BEHIND
        self._holder.drive(state.X_WE, self._plant.time + behind)
        self._q = state.q
        return ""

    def _rejoin(self, robot: PlantLink) -> str:
        """Somebody set its clock, or it began anew with an arm elsewhere: its arm is where the plant's flange is."""
        clock = self.stamp if self._clock else None
        try:
            robot.place(self._plant.X_WE, self._q, clock, patience=0.0, stay=True)
        except SeedError as error:
            return str(error)
        self._robot_offset = self._ros_offset if self._clock else None
        return "the plant goes on from where it was"

    def _waits(self, steady: float) -> bool:
        """Whether the plant stands still for a process that this machine is too busy to run in time."""
        late = {topic for topic, stream in self.streams.items() if stream.late(self.stamp, steady)}
        if not self.streams["target_frame"].runs:
            late.discard("current_pose")  # nobody steers by it, and a driver that starts its program says nothing
        return self._clock and bool(late)

    def _lose(self, lost: float) -> None:
        """Wall time [s] in which the plant did not move; its own clock knows nothing of it."""
        self._steady_offset += lost
        self.lost += lost
        if not self._clock:
            self._ros_offset += lost
