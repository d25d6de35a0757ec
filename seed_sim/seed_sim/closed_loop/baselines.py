# SPDX-License-Identifier: Apache-2.0
"""Baselines of the evaluation: a taught path that barely touches; a tool bolted to the gripper with force control."""

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks import Task
from seed_core.hand import weight_about_T
from seed_core.spatial import Array, inverse_pose, so3_exp
from seed_sim.plant.plant import Plant

WELDED = ("welded", "welded_roll")
BASELINES = ("open_loop", *WELDED)
DT = 0.004  # [s] of a control step
_TOUCH = -1e-4  # [m] depth of the taught path: the arm's repeatability
_APPROACH = 0.03  # [m/s]
_ADMITTANCE = 1.5e-3  # [m/s per N] of the welded tool along z
_SLOPE_TIME = 0.5  # [s] in which the speed is learnt at which a slope has to be followed, that no force error stays
_ROLL_ADMITTANCE, _MAX_ROLL_RATE = 0.3, 0.3  # [rad/s per N m], [rad/s] of the welded tool about x, with roll control


class BaselineSteering:
    """Follows the reference; along z it obeys an ideal force sensor (welded), or stays at the taught height."""

    rate = 1.0 / DT

    def __init__(self, plant: Plant, task: Task, kind: str) -> None:
        self.plant, self.kind = plant, kind
        self.X_work = task.frame.pose
        self._z: float | None = None  # [m] of the tip over the nominal table, while force is controlled
        self._slope = 0.0  # [m/s] along z, learnt from the force error
        self._roll = 0.0  # [rad] about x_T, with roll control
        self._settled_steps = 0

    def sense(self, t: float) -> ControllerState:
        self.plant.advance(t)
        settled = self._settled_steps > 50
        return ControllerState(t, "contact", True, X_W_tip=self._tip(), in_contact=True, settled=settled)

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        del t
        if setpoint is not None:
            self.plant.command(self._target(setpoint))
        return ""

    def _tip(self) -> Array:
        return np.asarray(self.plant.X_WT @ self.plant.tool.X_Ttip)

    def _target(self, s: HybridSetpoint) -> Array:
        """Flange pose (4, 4) for this set-point."""
        X_W_tip = s.X_W_tip.copy()
        normal = self.X_work[:3, 2]
        if s.force_projector.any():
            if self._z is None:
                self._z = float(normal @ (self._tip()[:3, 3] - self.X_work[:3, 3]))
            self._z = self._taught_height(self._z) if self.kind == "open_loop" else self._force_height(self._z, s)
            X_W_tip[:3, 3] += normal * (self._z - normal @ (X_W_tip[:3, 3] - self.X_work[:3, 3]))
        else:
            self._z, self._slope = None, 0.0
        X_WT = X_W_tip @ inverse_pose(self.plant.tool.X_Ttip)
        if self.kind == "welded_roll":
            tip = X_W_tip[:3, 3]
            turn = so3_exp(self._roll * X_WT[:3, 0])
            X_WT[:3, :3] = turn @ X_WT[:3, :3]
            X_WT[:3, 3] = tip + turn @ (X_WT[:3, 3] - tip)
        X_WC = X_WT @ inverse_pose(self._sag(X_WT[:3, :3]))
        return np.asarray(X_WC @ inverse_pose(self.plant.hand.X_EC))

    def _sag(self, R_WT: Array) -> Array:
        """X_CT (4, 4) of the tool that hangs free: the taught path was taught with the tool in the grasp."""
        X = np.eye(4)
        if self.kind == "open_loop":
            weight = weight_about_T(self.plant.tool.mass, self.plant.tool.center_of_mass, R_WT)
            X[:3, 3] = weight.force / np.array(self.plant.scenario.grasp.stiffness.translation)
        return X

    def _taught_height(self, z: float) -> float:
        """Down to the nominal table at the approach speed."""
        z = max(z - _APPROACH * DT, _TOUCH)
        self._settled_steps = self._settled_steps + 1 if z <= _TOUCH else 0
        return z

    def _force_height(self, z: float, s: HybridSetpoint) -> float:
        """Up or down in proportion to the force error and, in contact, to its integral."""
        load, normal = self.plant.contact_wrench, self.X_work[:3, 2]
        pressed, wanted = -float(normal @ load.force), -float(normal @ s.R_W_task @ s.wrench.force)
        if self.kind == "welded_roll":
            torque = float(self.plant.X_WT[:3, 0] @ load.torque)
            self._roll -= DT * float(np.clip(_ROLL_ADMITTANCE * torque, -_MAX_ROLL_RATE, _MAX_ROLL_RATE))
        self._settled_steps = self._settled_steps + 1 if abs(pressed - wanted) < 0.1 * wanted else 0
        rise = _ADMITTANCE * (pressed - wanted)
        if self._settled_steps or self._slope:  # an approach says nothing of the surface
            self._slope = float(np.clip(self._slope + DT / _SLOPE_TIME * rise, -_APPROACH, _APPROACH))
        return z + DT * float(np.clip(rise + self._slope, -_APPROACH, _APPROACH))
