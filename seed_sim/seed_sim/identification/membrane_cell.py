# SPDX-License-Identifier: Apache-2.0
"""The identification cell with a tool between two membranes: quasi-static solves along the path from pose to pose."""

from dataclasses import replace

import numpy as np

from seed_core.spatial import Array, inverse_pose
from seed_sim.identification.cell import EstimatedPoses, SimulatedCell
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.membrane.hold import MembraneHold

_CREEPS = 0.5  # [s] between solves of a pose that rests


class MembraneCell(SimulatedCell):
    """Each width of the gripper is a grasp of its own: it opens and closes on the tool where that rests.

    The hidden stiffness of `truth` is the diagonal of the membranes' tangent at each grasp, which a fit over larger
    motions does not find: membranes stiffen, and slide.
    """

    def __init__(self, scenario: IdentificationScenario, seed: int, poses: TactilePoses | None = None) -> None:
        """The cell of a seed.

        Args:
            scenario: with `membrane`.
            seed: of the sensor's faults.
            poses: the estimator's view of the same membranes; None leaves it out.

        Raises:
            MembraneError: a membrane that cannot be inflated, or that the tool pierces at one of the widths.
        """
        super().__init__(scenario, seed, poses)
        self._poses = poses
        self.hold = poses.hold if poses is not None and poses.hold is not None else hold_of(scenario)
        widths = np.array(scenario.procedure.widths)
        squeeze = self.hold.parameters.squeeze
        self._squeezes = (squeeze + 0.5 * (float(np.median(widths)) - widths)).tolist()
        stiffness, gas = [], []
        for imprint in self._squeezes:
            self.hold.close(imprint)
            stiffness.append(np.diag(self.hold.state.tangent))
            gas.append(np.mean(list(self.hold.pressures.values())))
        self.truth = replace(self.truth, stiffness=np.array(stiffness), pressures=np.array(gas))
        self._grip: int | None = None
        self._load, self._solved, self._asked = np.zeros(6), -np.inf, np.full((4, 4), np.nan)

    def grip_anew(self) -> None:
        """At the next step the membranes are closed on the tool anew, and the estimator takes a new grasp."""
        self._grip = None

    def _spring(self, X_TC: Array, grip: int) -> Array:
        if grip != self._grip:
            self.hold.close(self._squeezes[grip], self.stamp)
            self._grip, self._asked = grip, np.full((4, 4), np.nan)
            if self._poses is not None:
                self._poses.take_grasp(self.stamp)
        rests = np.array_equal(X_TC, self._asked)
        if not rests or self.stamp - self._solved >= _CREEPS:
            self._load = self.hold.at(inverse_pose(X_TC), self.stamp).wrench.vector()
            self._asked, self._solved = X_TC.copy(), self.stamp
        return self._load

    def _pressures(self, grip: int) -> tuple[float, ...]:
        """What both bubbles report [hPa], of the gas as the tool's motion squeezes it, not of the grip alone."""
        del grip
        noise = self.scenario.grasp.pressure_noise * self._rng.normal(size=2)
        return tuple((np.array(list(self.hold.pressures.values())) + noise).tolist())


def hold_of(scenario: IdentificationScenario) -> MembraneHold:
    """The membranes of a scenario, closed on its tool. Raises MembraneError."""
    return MembraneHold(scenario.membrane, scenario.tactile.tool)


def cell_of(scenario: IdentificationScenario, seed: int, poses: EstimatedPoses | None = None) -> SimulatedCell:
    """The cell of a scenario, whichever grasp it has. Raises MembraneError."""
    if scenario.grasp.kind != "membrane":
        return SimulatedCell(scenario, seed, poses)
    return MembraneCell(scenario, seed, poses if isinstance(poses, TactilePoses) else None)
