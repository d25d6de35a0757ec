# SPDX-License-Identifier: Apache-2.0
"""Two membranes as the plant's grasp: solved at the camera's rate, linear about the last solve in between, damped."""

from math import ceil

import numpy as np

from seed_core.bushing import Stiffness
from seed_core.spatial import Array, Wrench, inverse_pose, so3_log
from seed_sim.membrane import MembraneError
from seed_sim.membrane.hold import MembraneHold
from seed_sim.membrane.state import push_of
from seed_sim.plant.grip import MOST_SUBSTEPS, PlantError, damping_of, rate_of
from seed_sim.plant.tools import ToolInertia
from seed_sim.scenario import Scenario

_FAR = 7e-4  # [m] from the last solve: then it is solved before its time
_SLACK = 1.5e-3  # [s] that a camera, which counts in whole steps, may be late
_ARM = 0.04  # [m] at which a turn moves the membrane
_MARGIN = 0.5  # of rate x step at the grasp: a membrane under load is stiffer


class MembraneGrip:
    """What `Grip` is to a bushing, and a `GraspForce` of the plant.

    Attributes:
        hold: the membranes.
        width: [m] between the fingers.
        substeps: parts that a step of the plant is cut into.
        damping: (3,) [N m s/rad] and (3,) [N s/m].
    """

    def __init__(self, scenario: Scenario, inertia: ToolInertia, step: float) -> None:
        """The grasp of a scenario on its tool.

        Raises:
            MembraneError: a membrane that cannot be inflated, or that the tool pierces.
            PlantError: no step that is small enough.
        """
        self._grasp, self._inertia, self._step = scenario.grasp, inertia, step
        self.hold = MembraneHold(scenario.membrane, scenario.tactile.tool)
        self.period = 1.0 / scenario.measurement.rate  # [s] between solves
        self.damping = damping_of(inertia, self.stiffness, scenario.grasp.damping_ratio)
        self._D = np.concatenate(self.damping)
        self.substeps = max(ceil(self._rate() * step / _MARGIN), 1)
        if self.substeps > MOST_SUBSTEPS:
            raise PlantError(
                f"scenario '{scenario.name}': the membranes' fastest mode, {self._rate():.0f} rad/s, would need "
                f"{self.substeps} sub-steps of a millisecond, at most {MOST_SUBSTEPS} are taken: give the tool the "
                "inertia of the gripper pads (grasp.pad_mass, grasp.pad_radius), or less damping"
            )
        self.width = scenario.grasp.nominal_width
        self.reset(0.0)

    def _rate(self) -> float:
        return rate_of(self._inertia, self.hold.state.tangent, np.diag(self._D))

    # the plant's force
    def reset(self, t: float) -> None:
        """The tool is taken anew, at X_CT = identity and time t [s]."""
        self.hold.restart(t)
        if self.width != self._grasp.nominal_width:
            self.hold.squeeze(self._squeeze(self.width))
        self._linearise(t)

    def wrench(self, X_TC: Array, V_TC: Array, t: float) -> Wrench:
        """See `GraspForce.wrench`."""
        motion = self._motion(X_TC)
        far = abs(motion[3]) + abs(motion[4]) + abs(motion[5])
        far += _ARM * (abs(motion[0]) + abs(motion[1]) + abs(motion[2]))
        if t >= self._next - 1e-9 or (far > _FAR and t > self._solved):
            self.solve(inverse_pose(X_TC), t)
            motion = self._motion(X_TC)
        load = self._load + self._K @ motion + self._D * V_TC
        return Wrench(load[:3], load[3:])

    def solve(self, X_CT: Array, t: float) -> None:
        """Solve the membranes with the tool at X_CT (4, 4) at time t [s]. Raises MembraneError."""
        self.hold.at(X_CT, t)
        self._linearise(t)

    def _linearise(self, t: float) -> None:
        state = self.hold.state
        X_TC = inverse_pose(state.X_CT)
        self._R_CT, self._p_TC = X_TC[:3, :3].T, X_TC[:3, 3]
        self._load, self._K = state.wrench.vector(), state.tangent
        self._solved, self._next = t, t + self.period + _SLACK

    def _motion(self, X_TC: Array) -> Array:
        """(6,) of C relative to T since the last solve: rotation vector and translation, in T."""
        out = np.empty(6)
        out[:3] = so3_log(X_TC[:3, :3] @ self._R_CT)
        out[3:] = X_TC[:3, 3] - self._p_TC
        return out

    # what the gripper knows
    @property
    def stiffness(self) -> Stiffness:
        """The diagonal of the tangent at the grasp, at this width."""
        return Stiffness.from_vector(np.maximum(np.diag(self.hold.state.tangent), 1e-3))

    @property
    def pressures(self) -> dict[str, float]:
        """Absolute pressure in each bubble [hPa]."""
        return self.hold.pressures

    @property
    def pressure(self) -> float:
        """Mean of both [hPa]."""
        return float(np.mean(list(self.pressures.values())))

    @property
    def push(self) -> float:
        """Of each finger on the tool [N], mean of both."""
        return push_of(self.hold.state)

    @property
    def rise(self) -> float:
        """Of that push per closed metre of width [N/m], from the tangent: a finger closes by half of it."""
        return float(self.hold.state.tangent[4, 4]) / 4.0

    def push_at(self, width: float) -> float:
        """Of each finger [N] with the fingers at a width [m] for which the membranes are not solved yet."""
        return max(self.push + self.rise * (self.width - width), 0.0)

    def _squeeze(self, width: float) -> float:
        """Imprint [m] at a width [m]: each finger moves by half."""
        return self.hold.parameters.squeeze + 0.5 * (self._grasp.nominal_width - width)

    def set_width(self, width: float) -> None:
        """Close to width [m], with the tool where it is.

        Raises:
            PlantError: the tool would pierce the membranes, lie loose between them, or cannot be integrated.
        """
        if width == self.width:
            return
        squeeze, before = self._squeeze(width), self.width
        if squeeze <= 0.0:
            raise PlantError(
                f"gripper width = {width:.4f} m would leave the tool loose: at most "
                f"{self._grasp.nominal_width + 2.0 * self.hold.parameters.squeeze:.4f} m hold it"
            )
        try:
            self.hold.squeeze(squeeze)
        except MembraneError as error:
            raise PlantError(f"gripper width = {width:.4f} m: {error}") from error
        if (product := self._rate() * self._step / self.substeps) >= 0.95:
            self.hold.squeeze(self._squeeze(before))
            raise PlantError(
                f"so firm a grip cannot be integrated with this tool (rate x step = {product:.2f}, below 0.95 is "
                "needed): close less"
            )
        self.width = width
        self._linearise(self._solved)
