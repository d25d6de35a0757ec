# SPDX-License-Identifier: Apache-2.0
"""A bench for the controller: an arm with lag, a tool that follows its springs at once, and a springy table.

Translation only; the tool keeps the gripper's rotation. Small enough to be checked by hand, deterministic, no Drake.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from seed_control.controller import Controller, ControllerParameters
from seed_control.monitor.pressure_check import PressureCheck
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_core.bushing import Bushing, Stiffness
from seed_core.estimate import Regrasp, RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, Hand, Tool
from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy
from seed_core.wrench_model import WrenchModel
from seed_core.wrench_settings import ReferenceSettings

DOWN = pose_from_rpy((np.pi, 0.0, 0.0), (0.5, 0.0, 0.02))  # tip pose: tool's z into the table
PRESS_Z = np.diag([0.0, 0.0, 1.0])
DT = 0.004


@dataclass
class Bench:
    """One arm, hand, tool and table. Heights in metres; delay of the estimate in seconds."""

    law: str = "seed"
    stiffness: Stiffness = DEFAULT_STIFFNESS
    believed: Stiffness | None = None
    pressure: PressureCheck | None = None
    references: ReferenceSettings = field(default_factory=ReferenceSettings)
    arm_noise: float | None = None  # [N] of the arm's own reading, which has an offset of newtons; None: it has none
    model: WrenchModel | None = None  # of the wrench, in place of the bushing
    parameters: ControllerParameters = field(default_factory=ControllerParameters)
    table: float = 0.0
    slope: float = 0.0  # rise of the table per metre along x
    bumps: tuple[float, float] = (0.0, 1.0)  # [m] amplitude and wavelength along x
    stamp_error: float = 0.0  # [s] by which images are dated late
    noise: float = 1e-9  # [m] white, of each image, from a fixed seed: no camera says the same twice to the last bit
    k_table: float = 4e4  # [N/m]
    lag: float = 0.015
    delay: float = 0.05
    image_rate: float = 45.0
    start: np.ndarray = field(default_factory=lambda: DOWN.copy())
    tool: Tool = field(default_factory=Tool)

    def __post_init__(self) -> None:
        self.hand = Hand()
        parameters = replace(self.parameters, law=self.law)
        believed = self.believed or self.stiffness
        self.controller = Controller(
            parameters, self.hand, self.tool, believed, self.model, self.references, self.pressure
        )
        self.X_WE = self.start @ inverse_pose(self.tool.X_Ttip) @ inverse_pose(self.hand.X_EC)
        self.t, self._next_image = 0.0, 0.0
        self._queue: list[tuple[float, RelativePoseEstimate]] = []
        self.estimates = self.kinematics = self.turns = True
        self._rng, self._image_rng = np.random.default_rng(3), np.random.default_rng(4)
        self.force = 0.0  # on the table, positive when pressed [N]
        self.forces: list[float] = []
        self.commands: list[np.ndarray] = []
        self.state: ControllerState = self.controller.state
        self.observed = (True,) * 6
        self.regrasp = Regrasp()
        self.X_TT_new = np.eye(4)  # T as it is counted since the last `initialize_grasp`
        self.told: Callable[[RelativePoseEstimate], RelativePoseEstimate] = lambda estimate: estimate
        self.lost: Callable[[RelativePoseEstimate], bool] = lambda _: False  # of the messages

    def grasp(self) -> np.ndarray:
        """X_CT in equilibrium, and the force on the table."""
        K = np.array(self.stiffness.translation)
        X_WC = self.X_WE @ self.hand.X_EC
        p_WT = X_WC[:3, 3] - np.array((0.0, 0.0, self.tool.mass * 9.81 / K[2]))
        height, wavelength = self.bumps
        surface = self.table + self.slope * (p_WT[0] - 0.5) + height * np.sin(2.0 * np.pi * p_WT[0] / wavelength)
        tip = p_WT[2] - self.tool.X_Ttip[2, 3]
        self.force = 0.0
        if tip < surface:
            rise = (surface - tip) * self.k_table / (self.k_table + K[2])
            p_WT[2] += rise
            self.force = K[2] * rise
        return inverse_pose(X_WC) @ make_pose(X_WC[:3, :3], p_WT)

    def tip_height(self) -> float:
        X_WT = self.X_WE @ self.hand.X_EC @ self.grasp()
        return float((X_WT @ self.tool.X_Ttip)[2, 3])

    def step(self) -> ControllerState:
        X_CT = self.grasp()
        if self.kinematics:
            self.controller.add_kinematics(self.t, self.X_WE)
        if self.arm_noise is not None:
            self.controller.add_arm_wrench(self.t, self.arm_reading(X_CT))
        if self.t >= self._next_image:
            self._next_image += 1.0 / self.image_rate
            X = X_CT @ self.X_TT_new
            if self.noise:
                X[:3, 3] += self.noise * self._image_rng.standard_normal(3)
            told = RelativePoseEstimate(self.t + self.stamp_error, X, observed=self.observed)
            self._queue.append((self.t + self.delay, self.regrasp.through(self.told(told))))
        while self._queue and self._queue[0][0] <= self.t + 1e-9:
            estimate = self._queue.pop(0)[1]
            if self.estimates and not self.lost(estimate):
                self.controller.add_estimate(estimate)
        out = self.controller.step(self.t)
        assert out.X_WE is not None
        self.commands.append(out.X_WE)
        self.forces.append(self.force)
        share = 1.0 - np.exp(-DT / self.lag)
        R_WE = out.X_WE[:3, :3] if self.turns else self.X_WE[:3, :3]
        self.X_WE = make_pose(R_WE, self.X_WE[:3, 3] + share * (out.X_WE[:3, 3] - self.X_WE[:3, 3]))
        self.t += DT
        self.state = out.state
        return out.state

    def arm_reading(self, X_CT: np.ndarray) -> Wrench:
        """Load of the spring's reaction on the flange about its origin, in E, with an offset."""
        X_EC = self.hand.X_EC
        on_hand = Wrench.zero().minus(Bushing(self.stiffness).wrench(inverse_pose(X_CT)))
        X_ET = X_EC @ X_CT
        force = X_ET[:3, :3] @ on_hand.force
        torque = X_ET[:3, :3] @ on_hand.torque + np.cross(X_ET[:3, 3], force)
        noise = (self.arm_noise or 0.0) * self._rng.standard_normal(6)
        offset = np.array((0.1, -0.2, 0.1, 2.0, -3.0, 4.0))
        return Wrench.from_vector(np.concatenate((torque, force)) + offset + noise * np.array((0.1,) * 3 + (1.0,) * 3))

    def run(self, seconds: float) -> ControllerState:
        for _ in range(round(seconds / DT)):
            self.step()
        return self.state

    def enabled(self) -> Bench:
        """Warmed up and enabled."""
        self.run(0.2 + self.delay)
        self.controller.enable(self.t)
        self.step()
        return self

    def initialize_grasp(self, images: int = 8, announced: bool = True) -> None:
        """T := C, as an estimator does it that averages so many images."""
        if announced:
            self.regrasp.begin("grasp")
        self.run((images + 0.5) / self.image_rate)
        self.X_TT_new = inverse_pose(self.grasp())
        self.regrasp.end()

    def press(self, force: float, **more: object) -> HybridSetpoint:
        """Set-point: press downwards with a force, everything else held where the bench started."""
        setpoint = HybridSetpoint(
            self.start,
            Wrench(np.zeros(3), np.array((0.0, 0.0, -force))),
            PRESS_Z,
            **more,  # type: ignore[arg-type]
        )
        self.controller.set_setpoint(setpoint, self.t)
        return setpoint
