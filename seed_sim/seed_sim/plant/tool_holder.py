# SPDX-License-Identifier: Apache-2.0
"""A holder in which the tool stands: it carries the tool's weight after a grasp, until the arm moves."""

import numpy as np

from seed_core.hand import weight_about_T
from seed_core.spatial import Array
from seed_sim.plant.plant import DT, Plant

MOVED = 5e-4  # [m] from where the tool was grasped: then the holder lets it down
LETTING_DOWN = 0.4  # [s] in which the tool's weight is given to the grasp: membranes would remember a fall


class ToolHolder:
    """Moves the plant on with the tool in the holder, or in the grasp alone.

    Attributes:
        grasped: whether the gripper holds the tool.
        carries: whether the holder does, too.
    """

    def __init__(self, plant: Plant) -> None:
        """The tool stands in the holder, in front of an open gripper."""
        self._plant = plant
        self.grasped, self.carries = False, True
        if plant.membranes is not None:
            plant.carry(1.0)
        self._grasped_at = plant.X_WE
        self._given = 0.0  # share of the tool's weight that the grasp carries

    def grasp(self) -> None:
        """Close the gripper on the tool."""
        self._stand()
        self.grasped, self.carries, self._given = True, True, 0.0
        self._grasped_at = self._plant.X_WE.copy()

    def release(self) -> None:
        """Open the gripper; the tool stands in the holder."""
        self._stand()
        self.grasped, self.carries, self._given = False, True, 0.0

    def _stand(self) -> None:
        """The tool stands in the holder, where the grasp is."""
        self._plant.grasp()
        if self._plant.membranes is not None:
            self._plant.carry(1.0)

    def advance(self, t: float) -> None:
        """Move the plant, with an arm of its own, on to its time t [s]."""
        before = self._plant.time
        if self.carries and self._plant.membranes is None:
            while self._plant.time < t - DT:
                self._plant.advance(self._plant.time + DT)
                self._hold()
        else:
            self._plant.advance(t)
        self._let_down(self._plant.time - before)

    def drive(self, X_WE: Array, t: float) -> None:
        """Move the plant on to its time t [s] with the flange at X_WE (4, 4); hardly any time: leave it there."""
        before = self._plant.time
        if t - before > 0.5 * DT:
            self._plant.drive(X_WE, t)
        if self.carries and self._plant.membranes is None:
            self._hold()
        self._let_down(self._plant.time - before)

    def _hold(self) -> None:
        """The tool hangs in the bushing as far as its weight is given to it: p_CT = weight / stiffness.

        Membranes remember how the tool has moved: in them it floats, see `Plant.carry`.
        """
        scenario, plant = self._plant.scenario, self._plant
        weight_C = weight_about_T(scenario.tool_mass, scenario.tool.center_of_mass, plant.X_WC[:3, :3]).force
        plant.grasp(self._given * np.asarray(weight_C / np.array(plant.stiffness.translation)))

    def _let_down(self, dt: float) -> None:
        """Let the tool down gently once the arm moves; dt: [s] since the last time."""
        moved = float(np.abs(self._plant.X_WE[:3, 3] - self._grasped_at[:3, 3]).max())
        if self.carries and self.grasped and (moved > MOVED or self._given > 0.0):
            self._given += dt / LETTING_DOWN
            self.carries = self._given < 1.0
            if self._plant.membranes is not None:
                self._plant.carry(1.0 - min(self._given, 1.0))
