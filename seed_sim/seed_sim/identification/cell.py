# SPDX-License-Identifier: Apache-2.0
"""A simulated cell for identification: arm, grasp, fixed force/torque sensor and gripper, quasi-static.

The stiffness, the sensor's faults and the arm's repeatability are drawn from the seed; the identification sees readings
only. The grasp is the bushing of seed_core (checked against Drake in its tests) with a membrane that settles and
creeps, and, where the scenario asks, elastic-then-sliding friction along single axes. `membrane_cell` has membranes.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_core.spatial import Array, inverse_pose, make_pose, pose_from_rpy, so3_exp
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.truth import direction, draw_truth
from seed_sysid.run.procedure import Command, Reading
from seed_sysid.stiffness_map import AXES, offset_pose, stiffness_map, wrench_transform

_CREEP = 5.0  # creep is this many times slower than settling
_DRIFT_TIME = 600.0  # [s]; the scenario's drift is over this time
_RESTS = 4.0  # [s] that a pose takes to come to rest, about

# From X_CT, stamp [s], and whether it is being measured: an estimate, None without an image.
EstimatedPoses = Callable[[Array, float, bool], RelativePoseEstimate | None]


class SimulatedCell:
    """Answers commands with readings at a fixed rate."""

    def __init__(self, scenario: IdentificationScenario, seed: int, pose_source: EstimatedPoses | None = None) -> None:
        """pose_source renders and estimates poses; None leaves the estimator's poses out."""
        self.scenario, self._pose_source = scenario, pose_source
        self._rng = np.random.default_rng([seed, 0x5EED])
        self.truth = draw_truth(scenario, self._rng)
        self._bushings = [Bushing(Stiffness.from_vector(k), scenario.procedure.fit.model) for k in self.truth.stiffness]
        X_TS = pose_from_rpy(np.deg2rad(scenario.sensor_rpy_deg), scenario.sensor_position)
        self._to_sensor = wrench_transform(inverse_pose(X_TS)) @ wrench_transform(offset_pose(self.truth.offset))
        self._friction = np.array([scenario.grasp.hysteresis.get(a, 0.0) for a in AXES])
        self._yield = scenario.grasp.yield_share * scenario.procedure.excitation.amplitudes
        self._z, self._xi = np.zeros(6), np.zeros(6)
        self._error, self._goal = np.eye(4), np.eye(4)
        self._lag = np.zeros((2, 6))
        self._disturbance = np.zeros(6)
        self._still, self.outliers = True, 0
        self._width = float(np.median(scenario.procedure.widths))  # [m]
        self.stamp = 0.0

    def step(self, command: Command) -> Reading:
        """Advance one period under a command."""
        s, dt = self.scenario, 1.0 / self.scenario.rate
        self.stamp += dt
        self._width = self._width if command.width is None else command.width
        moving = bool(np.abs(command.X_TC - self._goal).max() > 1e-12)
        if self._still and moving:
            self._new_pose()
        self._still, self._goal = not moving, command.X_TC
        X_TC = command.X_TC @ self._error
        static = self._spring(X_TC, command.grip)
        decay = np.exp(-dt / (s.grasp.settle_time * np.array([1.0, _CREEP])))
        shares = np.array([1.0 - s.grasp.creep, s.grasp.creep])
        self._lag = decay[:, None] * self._lag + (1.0 - decay)[:, None] * shares[:, None] * static
        pressures = self._pressures(command.grip)
        seen = self._pose_source(inverse_pose(X_TC), self.stamp, command.measuring) if self._pose_source else None
        sensed = self._sensed(self._lag.sum(axis=0))
        if seen is None or not seen.valid:
            followed = None if seen is None else False
            return Reading(self.stamp, command.X_TC, sensed, self._width, pressures, followed=followed)
        membrane = self.with_pressure(seen.membrane, pressures)
        X_seen = inverse_pose(seen.of_patches().X_CT)
        return Reading(
            self.stamp, command.X_TC, sensed, self._width, pressures, X_seen, membrane=membrane, followed=True
        )

    def grip_anew(self) -> None:
        """Open the gripper and close it on the tool again, at the centre: friction forgets what was before."""
        self._z, self._xi = np.zeros(6), np.zeros(6)

    @staticmethod
    def with_pressure(membrane: tuple[MembraneMotion, ...], pressures: tuple[float, ...]) -> tuple[MembraneMotion, ...]:
        """The motions, with the pressures [hPa] of the left and of the right bubble."""
        told = dict(zip(FINGERS, pressures, strict=True))
        return tuple(replace(m, pressure=told[m.finger]) for m in membrane)

    def rest(self, command: Command, count: int) -> list[Reading]:
        """Readings of a pose that has come to rest, without simulating how."""
        self._new_pose()
        X_TC, self._goal = command.X_TC @ self._error, command.X_TC
        self._lag = np.array([self._spring(X_TC, command.grip), np.zeros(6)])
        self.stamp += _RESTS
        self._width = self._width if command.width is None else command.width
        pressures = self._pressures(command.grip)
        sensed = [self._sensed(self._lag[0]) for _ in range(count)]
        return [Reading(self.stamp, command.X_TC, w, self._width, pressures) for w in sensed]

    def _pressures(self, grip: int) -> tuple[float, ...]:
        """What both bubbles report [hPa]."""
        noise = self.scenario.grasp.pressure_noise * self._rng.normal(size=2)
        return tuple((self.truth.pressures[grip] + noise).tolist())

    def _new_pose(self) -> None:
        """The arm sets off: another repeatability error, perhaps another disturbance."""
        s, rng = self.scenario, self._rng
        turn = np.deg2rad(s.repeatability_deg) * rng.normal(size=3)
        self._error = make_pose(so3_exp(turn), s.repeatability * rng.normal(size=3))
        hit = rng.uniform() < s.sensor.outliers
        size = np.repeat([s.sensor.outlier_torque, s.sensor.outlier_force], 3)
        self._disturbance = hit * size * np.concatenate([direction(rng), direction(rng)])
        self.outliers += int(hit)

    def _spring(self, X_TC: Array, grip: int) -> Array:
        """Load on the tool at rest (6,) about T, in T, friction included."""
        w = self._bushings[grip].wrench(X_TC).vector()
        if not self._friction.any():
            return w
        (B,), (xi,) = stiffness_map(X_TC[None], self.scenario.procedure.fit.model)
        self._z = np.clip(self._z + (xi - self._xi) / self._yield, -1.0, 1.0)
        self._xi = xi
        return np.asarray(w + B @ (self._friction * self._z))

    def _sensed(self, w_T: Array) -> Array:
        """What the sensor reports (6,) about S, in S, for the load w_T about T, in T."""
        sensor = self.scenario.sensor
        noise = self._rng.normal(size=6) * np.repeat([sensor.torque_noise, sensor.force_noise], 3)
        drift = self.truth.drift * self.stamp / _DRIFT_TIME
        full = np.repeat([sensor.range_torque, sensor.range_force], 3)
        sensed = self._to_sensor @ w_T + self.truth.bias + drift + self._disturbance + noise
        return np.asarray(np.clip(sensed, -full, full))
