# SPDX-License-Identifier: Apache-2.0
"""The simulated gripper's topics: gripper/command [m] and gripper/force_command [N] in, gripper/force [N] out."""

from collections.abc import Callable
from math import isfinite

from std_msgs.msg import Float64

from seed_ros import COMMAND, QUEUE, SeedNode
from seed_sim.gripper.gripper import SimulatedGripper
from seed_sim.plant.grip import PlantError
from seed_sim.plant.membrane_grip import MembraneGrip
from seed_sim.plant.plant import Plant
from seed_sim.ros.every import Every

_MOVED = 2e-5  # [m] from which the grasp is told of a motion
_PERIOD = 0.04  # [s] between two gripper/force


class Fingers:
    """Carries commands out at the gripper's rate, latency and force limit. `advance` is called once per tick."""

    def __init__(self, node: SeedNode, plant: Plant, grasped: Callable[[], bool]) -> None:
        """Listen and tell from now on; grasped: whether the fingers push on the tool, or else on nothing."""
        self._node, self._plant, self._grasped = node, plant, grasped
        self._gripper = SimulatedGripper(plant.scenario.gripper, plant.grip.width)
        self._then = self._closed = plant.time
        self._every = Every(_PERIOD)
        self._force = node.publisher(Float64, "gripper/force", QUEUE)
        node.loop.poll(Float64, "gripper/command", self._on_width, COMMAND)
        node.loop.poll(Float64, "gripper/force_command", self._on_force, COMMAND)

    def _on_width(self, message: Float64) -> None:
        with self._node.counters.refusing("widths_refused"):
            if not isfinite(message.data) or message.data < 0.0:
                raise PlantError(f"gripper width = {message.data} m must be finite and not negative")
            self._gripper.command_width(self._plant.time, message.data)

    def _on_force(self, message: Float64) -> None:
        with self._node.counters.refusing("forces_refused"):
            if not isfinite(message.data) or message.data < 0.0:
                raise PlantError(f"gripper force = {message.data} N must be finite and not negative")
            self._gripper.command_force(self._plant.time, message.data)

    def restart(self) -> None:
        """The fingers are where the plant's are, without commands."""
        self._gripper.restart(self._plant.grip.width)
        self._then = self._closed = self._plant.time

    def advance(self) -> None:
        """Move up to the plant's time; membranes are solved for it at their own rate."""
        plant, grip = self._plant, self._plant.grip
        t, dt = plant.time, plant.time - self._then
        self._then = t
        if dt > 0.0:
            self._gripper.advance(t, dt, grip.push_at(self._gripper.width), grip.rise)
        due = not isinstance(grip, MembraneGrip) or not 0.0 <= t - self._closed < grip.period
        if due and abs(self._gripper.width - grip.width) > _MOVED:
            self._closed = t
            try:
                plant.set_gripper_width(self._gripper.width)
            except PlantError as error:
                self._gripper.restart(grip.width)
                self._node.counters.add("widths_refused", str(error))
        if self._every.due(t):
            self._force.publish(Float64(data=float(grip.push) if self._grasped() else 0.0))
