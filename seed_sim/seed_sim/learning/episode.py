# SPDX-License-Identifier: Apache-2.0
"""One episode of a cell: plant, estimator and controller, driven by hybrid set-points at a slower rate."""

from typing import Literal, NamedTuple

import numpy as np

from seed_control.setpoint.setpoints import HybridSetpoint, SetpointError
from seed_control.state import ControllerState
from seed_control.tasks import load_task
from seed_core.arm.quaternion import Quaternion, as_quaternion, continued
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rotation_from_rpy, so3_log
from seed_estimation import TactileImages
from seed_sim.closed_loop.recording import lean_of
from seed_sim.closed_loop.relative_poses import FROM_IMAGES, PoseSource, pose_source
from seed_sim.closed_loop.run import SETTLE, SeedSteering, start_pose
from seed_sim.learning.strip import Strip
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario
from seed_sim.world.cell import make_plant
from seed_sim.world.draw import draw_world
from seed_sim.world.poses import WorldPoses

WorldName = Literal["known", "hidden"]
WORLDS: tuple[WorldName, ...] = ("known", "hidden")
STEPS = 10  # of the controller for one of the environment: 25 Hz
LOW, HIGH = np.array((-0.02, -0.05, 0.02)), np.array((0.28, 0.05, 0.05))  # [m] bounds of the reference
_ALONG_Z = np.diag((0.0, 0.0, 1.0))
_PRESSED = (True, False, False)  # the blade is a line along y: torque about T's x, which the contact resists


class Wanted(NamedTuple):
    """A hybrid set-point for the next step, in the task frame.

    Attributes:
        force: [N] to press with; 0: z follows the velocity instead.
        torque: [N m] about the tool's x, while pressing.
        velocity: (3,) [m/s] of the tip; its z counts while not pressing.
    """

    force: float
    torque: float
    velocity: Array


class Episode:
    """From the enabled controller on, the tool above the start of the strip.

    Attributes:
        state: the controller's newest. estimate: the newest relative pose.
        reference: (3,) [m] wanted tip in the task frame.
        arm_pose: (7,) reported flange in the task frame: position [m], quaternion x y z w, of whose two signs the one
            that goes on from the step before.
        refusal: why the last set-point was refused, or ''.
    """

    def __init__(self, scenario: Scenario, estimator: str, world: WorldName, seed: int) -> None:
        """Build the cell of a seed and let the tool hang until the controller is enabled. Raises SeedError."""
        task = load_task("squeegee")
        self.X_work = task.frame.pose
        self._R_tip = self.X_work[:3, :3] @ rotation_from_rpy(np.deg2rad(task.tip_rpy))
        self.plant, self._poses = _cell(scenario, estimator, world, seed)
        self._heard = _Listening(self._poses)
        self._steering = SeedSteering(self.plant, scenario, "seed", estimator, seed, self._heard)
        self._n, self.refusal = 0, ""
        self.state: ControllerState = self._steering.sense(0.0)
        for _ in range(round((SETTLE + 0.2) * self._steering.rate)):
            self._control(None)
        if self.failure:
            raise SeedError(f"the cell of seed {seed} cannot be enabled: {self.failure}")
        self.reference = np.clip(self.tip, LOW, HIGH)
        self._pressing = False
        self._turned: Quaternion | None = None  # of the arm pose before
        self.arm_pose = self._arm_pose()

    @property
    def rate(self) -> float:
        """[Hz] of the environment's steps."""
        return self._steering.rate / STEPS

    @property
    def time(self) -> float:
        """[s] of the plant."""
        return self.plant.time

    @property
    def failure(self) -> str:
        """Why the arm holds; '' while it follows."""
        held = self.state.mode in ("holding", "disabled")
        return self.state.reason if held else ""

    def drive(self, wanted: Wanted, strip: Strip) -> None:
        """One step of the environment: the reference moves on, the strip is passed over."""
        self._drive(wanted, strip)
        self.arm_pose = self._arm_pose()

    def _drive(self, wanted: Wanted, strip: Strip) -> None:
        dt, pressing = 1.0 / self._steering.rate, wanted.force > 0.0
        velocity = np.array(wanted.velocity, float)
        if pressing:
            velocity[2] = 0.0
        if pressing or self._pressing:  # on from where the tip is, along z
            self.reference[2] = self.tip[2]
        self._pressing = pressing
        setpoint = self._setpoint(wanted, pressing)
        for _ in range(STEPS):
            before = self.reference.copy()
            self.reference = np.clip(before + dt * velocity, np.minimum(LOW, before), np.maximum(HIGH, before))
            moving = self.X_work[:3, :3] @ ((self.reference - before) / dt)
            self._control(setpoint.moved(self._in_world(self.reference), moving))
            if self.failure:
                return
            strip.passed(self.tip_true, self.pressing_force)

    def _setpoint(self, wanted: Wanted, pressing: bool) -> HybridSetpoint:
        X, R = self._in_world(self.reference), self.X_work[:3, :3]
        if not pressing:
            return HybridSetpoint(X, task_frame="surface", R_W_task=R)
        torque = self._R_tip[:, 0] * wanted.torque
        load = Wrench(R.T @ torque, np.array((0.0, 0.0, -wanted.force)))
        return HybridSetpoint(X, load, _ALONG_Z, _PRESSED, "surface", R, _PRESSED)

    def _in_world(self, tip: Array) -> Array:
        return make_pose(self._R_tip, (self.X_work @ np.append(tip, 1.0))[:3])

    def _control(self, setpoint: HybridSetpoint | None) -> None:
        t = self._n / self._steering.rate
        self._n += 1
        self.state = self._steering.sense(t)
        try:
            self.refusal = self._steering.steer(t, setpoint)
        except SetpointError as error:
            self.refusal = str(error)
        self.state = self._steering.controller.state

    @property
    def estimate(self) -> RelativePoseEstimate:
        """The newest relative pose that has arrived."""
        return self._heard.newest

    @property
    def images(self) -> dict[str, TactileImages]:
        """The newest, by finger; empty where poses do not come from images."""
        return getattr(self._poses, "images", {})

    @property
    def tip(self) -> Array:
        """(3,) [m] in the task frame, as measured."""
        X = self.state.X_W_tip
        return self.tip_true if X is None else (inverse_pose(self.X_work) @ X)[:3, 3]

    @property
    def tip_true(self) -> Array:
        """(3,) [m] in the task frame, of the plant."""
        return (inverse_pose(self.X_work) @ self.plant.X_WT @ self.plant.tool.X_Ttip)[:3, 3]

    @property
    def pressing_force(self) -> float:
        """[N] of the tool on the table along -z of the task frame, of the plant."""
        return float(-self.X_work[:3, 2] @ self.plant.contact_wrench.force)

    @property
    def lean(self) -> float:
        """[rad] of the true tool about the axes that hold their angle."""
        R_ref = self._R_tip @ self.plant.tool.X_Ttip[:3, :3].T
        return float(np.linalg.norm(lean_of(R_ref, self.plant.X_WT[:3, :3])[1:]))

    def _arm_pose(self) -> Array:
        X = inverse_pose(self.X_work) @ self._steering.X_WE_reported
        self._turned = continued(as_quaternion(X[:3, :3]), self._turned)
        return np.array((*X[:3, 3], *self._turned))

    @property
    def relative_pose(self) -> Array:
        """(6,) the newest estimate of X_CT: rotation vector [rad], translation [m]."""
        X = self.estimate.X_CT
        return np.concatenate((so3_log(X[:3, :3]), X[:3, 3]))

    @property
    def wrench(self) -> Array:
        """(6,) as the controller estimates it, of the tool on the table about the tip, in the task frame [N m, N]."""
        load = self.state.estimated
        return np.zeros(6) if load is None else load.rotated(self.X_work[:3, :3].T @ self.state.R_W_task).vector()


class _Listening(PoseSource):
    """A source of relative poses that remembers the newest that has arrived."""

    def __init__(self, source: PoseSource) -> None:
        self._source = source
        self.newest = RelativePoseEstimate(0.0, np.eye(4), valid=False, reason="none has arrived yet")

    def next_image(self) -> float:
        return self._source.next_image()

    def take_image(self, plant: Plant) -> None:
        self._source.take_image(plant)

    def arrived(self, t: float) -> list[RelativePoseEstimate]:
        estimates = self._source.arrived(t)
        if estimates:
            self.newest = estimates[-1]
        return estimates


def _cell(scenario: Scenario, estimator: str, world: WorldName, seed: int) -> tuple[Plant, PoseSource]:
    """The plant and what measures the tool in the grasp."""
    task, rate = load_task("squeegee"), 250.0
    if world == "known":
        plant = Plant(scenario, seed, task.frame.pose, start_pose(scenario, task))
        return plant, pose_source(estimator, scenario, seed, rate, plant)
    drawn = draw_world(seed)
    plant = make_plant(scenario, drawn, seed, task)
    if estimator in FROM_IMAGES:
        return plant, WorldPoses(scenario, drawn, seed, estimator, plant=plant)
    return plant, pose_source(estimator, scenario, seed, rate, plant)
