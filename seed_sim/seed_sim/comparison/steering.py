# SPDX-License-Identifier: Apache-2.0
"""A rival law in front of the plant: its sensor, the reference that it follows, and the arm that obeys."""

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState, Mode
from seed_core.spatial import Array, Wrench, inverse_pose
from seed_sim.plant.plant import DT, Plant
from seed_sim.rivals.impedance import PERIOD as TORQUE_PERIOD
from seed_sim.rivals.impedance import Impedance, TorqueArm
from seed_sim.rivals.law import RivalLaw, Wanted, flange_pose, touches
from seed_sim.rivals.sensor import ForceReader

RATE = 250.0  # [Hz] of set-points, as for our controller
ZEROING = (0.1, 0.6)  # [s] in which the sensor is zeroed, the tool hanging free
PROTECTIVE_STOP = 150.0  # [N] at which a UR stops by default (safety configuration, tool force)


class _Sensing:
    """What both kinds of rivals share: a zeroed reading about the tip, and a state for the task's player."""

    rate = RATE

    def __init__(self, plant: Plant, reader: ForceReader) -> None:
        self._plant, self._reader = plant, reader
        self._X_Ttip, self._X_CE = plant.tool.X_Ttip, inverse_pose(plant.hand.X_EC)
        self._X_E_tip, self._R_EC = plant.hand.X_EC @ plant.tool.X_Ttip, plant.hand.X_EC[:3, :3]
        self._zero, self._zeroing, self._zeroed = np.zeros(6), np.zeros(6), 0
        self._measured = np.zeros(6)
        self._setpoint: HybridSetpoint | None = None
        self._next_reading = 0.0
        self._stopped = ""

    def _read(self, t: float) -> None:
        """Take the readings that are due at t [s]; the zero is their mean while the tool hangs free."""
        if t + 1e-9 < self._next_reading:
            return
        self._next_reading += self._reader.period
        load = self._load()
        if t < ZEROING[1]:
            if t >= ZEROING[0]:  # what zeroing leaves is the sensor's `force_offset`; the weight goes with the zero
                self._zeroing, self._zeroed = self._zeroing + load, self._zeroed + 1
            return
        if self._zeroed:
            self._zero, self._zeroed = self._zeroing / self._zeroed, 0
        on_flange = Wrench.from_vector(self._reader.read(t, load - self._zero))
        X_WE, s = self._plant.X_WE, self._setpoint
        R_W_task = s.R_W_task if s is not None else np.eye(3)
        R_WT = X_WE[:3, :3] @ self._R_EC
        at_tip = on_flange.about(self._X_E_tip[:3, 3]).rotated(X_WE[:3, :3])
        self._measured = -np.concatenate([R_WT.T @ at_tip.torque, R_W_task.T @ at_tip.force])
        if (self._measured[3:] ** 2).sum() > PROTECTIVE_STOP**2:
            self._stopped = f"protective stop at {np.linalg.norm(self._measured[3:]):.0f} N"

    def _load(self) -> Array:
        """The true load on the flange about its origin (6,)."""
        return self._plant.ft_wrench.vector()

    def _state(self, t: float) -> ControllerState:
        X_W_tip = self._plant.X_WE @ self._X_E_tip
        mode: Mode = "holding" if self._stopped else "contact"
        wanted = _wanted(self._setpoint)
        error = np.abs(wanted.error(self._measured)[3:])
        settled = bool((error <= np.maximum(0.1 * np.abs(wanted.load[3:]), 0.3)).all())
        return ControllerState(
            t, mode, t >= ZEROING[1], X_W_tip=X_W_tip, reason=self._stopped, in_contact=settled, settled=settled
        )

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        """Follow this set-point from now on."""
        del t
        if setpoint is not None:
            self._setpoint = setpoint
        return ""


def _wanted(s: HybridSetpoint | None) -> Wanted:
    if s is None:
        return Wanted(np.zeros(6), np.zeros(6))
    free = np.concatenate([np.array(s.torque_axes, dtype=float), np.diag(s.force_projector)])
    return Wanted(s.wrench.vector(), free)


class PositionSteering(_Sensing):
    """A law that moves the flange of a position-controlled arm; it takes over where the tool touches.

    As people do with URScript's tool_contact, or any guarded move: down at an even speed until the sensor feels
    something, then the law. Along free axes its offset counts from there.
    """

    def __init__(self, plant: Plant, law: RivalLaw, reader: ForceReader, approach: float) -> None:
        """approach: [m/s] until the tool touches."""
        super().__init__(plant, reader)
        self._law, self._approach = law, approach
        self._next_step = 0.0
        self._offset = np.zeros(6)
        self._anchor: Array | None = None  # (3,) place of the free axes [m], in the task's axes
        self._touched = False

    def sense(self, t: float) -> ControllerState:
        """Bring plant, sensor and law to t [s]."""
        tick = min(self._reader.period, self._law.period)
        while self._plant.time < t - 0.5 * DT:
            now = min(self._plant.time + max(tick, DT), t)
            self._plant.advance(now)
            self._read(now)
            if self._setpoint is not None and now + 1e-9 >= self._next_step and not self._stopped:
                self._next_step = now + self._law.period
                self._move(self._setpoint)
        return self._state(t)

    def _move(self, s: HybridSetpoint) -> None:
        wanted, X_W_tip, plant = _wanted(s), s.X_W_tip.copy(), self._plant
        if wanted.free.any():
            place = s.R_W_task.T @ X_W_tip[:3, 3]
            if self._anchor is None:
                self._anchor = place
            self._touched = self._touched or touches(wanted, self._measured)
            if self._touched:
                self._offset = self._law.step(wanted, self._measured)
            else:
                self._anchor = self._anchor + self._law.period * self._approach * np.sign(wanted.load[3:])
            X_W_tip[:3, 3] = s.R_W_task @ np.where(wanted.free[3:] > 0.0, self._anchor, place)
        elif self._anchor is not None:
            self._anchor, self._touched = None, False
            self._law.reset()
            self._offset = np.concatenate([self._offset[:3], np.zeros(3)])
        plant.command(flange_pose(X_W_tip, self._offset, s.R_W_task, self._X_Ttip, self._X_CE))


class TorqueSteering(_Sensing):
    """Cartesian impedance on an arm that obeys torques; the tool is held rigidly. It touches by a guarded move, too."""

    def __init__(self, plant: Plant, law: Impedance, arm: TorqueArm, reader: ForceReader, approach: float) -> None:
        """approach: [m/s] until the tool touches."""
        super().__init__(plant, reader)
        self._law, self._arm, self._approach = law, arm, approach
        self._offset = np.zeros(6)  # of the tip from the set-point [rad, m]
        self._place = np.zeros(3)  # of the set-point in the task's axes [m]
        self._way = np.zeros(3)  # [m] of the guarded move so far, in the task's axes
        self._touched = False

    def sense(self, t: float) -> ControllerState:
        """Bring plant, sensor and law to t [s]."""
        while self._plant.time < t - 0.5 * DT:
            now = self._plant.time + TORQUE_PERIOD
            if self._setpoint is None or self._stopped:
                self._plant.drive(self._plant.X_WE, now)
            else:
                self._move(self._setpoint, now)
            self._read(now)
        return self._state(t)

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        """The reference moves; the tip stays where it is."""
        if setpoint is not None:
            place = setpoint.R_W_task.T @ setpoint.X_W_tip[:3, 3]
            if self._setpoint is not None:
                self._offset[3:] -= place - self._place
            self._place = place
        return super().steer(t, setpoint)

    def _move(self, s: HybridSetpoint, now: float) -> None:
        wanted, plant = _wanted(s), self._plant
        controlled = wanted
        if not wanted.free.any():
            self._law.reset()
            self._touched, self._way = False, np.zeros(3)
        else:
            self._touched = self._touched or touches(wanted, self._measured)
            if not self._touched:
                controlled = Wanted(wanted.load, np.zeros(6))
                self._way = self._way + TORQUE_PERIOD * self._approach * np.sign(wanted.load[3:])
        off = self._offset - np.concatenate([np.zeros(3), self._way * wanted.free[3:]])
        commanded = self._law.step(controlled, self._measured, off, self._arm.speed)
        load, R_WT = plant.contact_wrench, plant.X_WT[:3, :3]
        on_environment = np.concatenate([R_WT.T @ load.torque, s.R_W_task.T @ load.force])
        self._offset = self._offset + self._arm.step(commanded, on_environment)
        plant.drive(flange_pose(s.X_W_tip, self._offset, s.R_W_task, self._X_Ttip, self._X_CE), now)
