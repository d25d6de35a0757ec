# SPDX-License-Identifier: Apache-2.0
"""Cost of a control step that presses with force, torque and position at once, and how evenly its node runs."""

import gc
import time
import tracemalloc

import numpy as np

from seed_control import Controller, ControllerParameters, HybridSetpoint
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, Hand, Tool
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, pose_from_rpy
from seed_testing.figures import figures

DT = 0.004  # [s]
_IMAGES = 6  # steps between images: 42 a second
_FORCE = 10.0  # [N]
_WARM_UP = 1000  # steps, more than histories and windows hold: all that lives on has been traced from its birth


class Pressing:
    """A controller that is fed a tool pressed with the wanted force, with noise, sliding along x."""

    def __init__(self) -> None:
        self.t, self._count = 0.0, 0
        self._rng = np.random.default_rng(0)
        tool = Tool()
        self.controller = Controller(ControllerParameters(), Hand(), tool, DEFAULT_STIFFNESS)
        self._X_W_tip = pose_from_rpy((np.pi, 0.0, 0.0), (0.4, 0.0, 0.0))
        self._X_WE = self._X_W_tip @ inverse_pose(tool.X_Ttip) @ inverse_pose(Hand().X_EC)
        lift = (_FORCE - tool.mass * GRAVITY) / DEFAULT_STIFFNESS.translation[2]
        self._X_CT = make_pose(None, (0.0, 0.0, -lift))  # z out of the flange: the pressed tool goes back
        wrench = Wrench(np.zeros(3), np.array((0.0, 0.0, -_FORCE)))
        about_x = (True, False, False)
        self._setpoint = HybridSetpoint(
            self._X_W_tip, wrench, np.diag((0.0, 0.0, 1.0)), torque_axes=about_x, contact_resists=about_x
        )
        self._feed()
        self.controller.step(self.t)
        self.controller.enable(self.t)

    def _feed(self) -> None:
        self.controller.add_kinematics(self.t, self._moved(self._X_WE))
        if self._count % _IMAGES == 0:
            noise = make_pose(None, 3e-4 * self._rng.standard_normal(3))
            self.controller.add_estimate(RelativePoseEstimate(self.t, noise @ self._X_CT))

    def _moved(self, X: Array) -> Array:
        return make_pose(None, (0.05 * np.sin(self.t), 0.0, 0.0)) @ X

    def step(self) -> float:
        """One step with its inputs and a set-point that moves; CPU time of the controller's step alone [us]."""
        self.t, self._count = self.t + DT, self._count + 1
        self._feed()
        velocity = np.array((0.05 * np.cos(self.t), 0.0, 0.0))
        self.controller.set_setpoint(self._setpoint.moved(self._moved(self._X_W_tip), velocity), self.t)
        began = time.thread_time()
        self.controller.step(self.t)
        return 1e6 * (time.thread_time() - began)


def growth(steps: int) -> float:
    """Bytes by which the memory in use grows per 1000 steps, once warm."""
    loop = Pressing()
    tracemalloc.start()
    try:
        in_use = []
        for count in (_WARM_UP, steps):
            for _ in range(count):
                loop.step()
            gc.collect()
            in_use.append(tracemalloc.get_traced_memory()[0])
        return (in_use[1] - in_use[0]) * 1e3 / steps
    finally:
        tracemalloc.stop()


def run(steps: int = 5000) -> dict[str, object]:
    """Cost of a step [us], CPU time of this thread, every sixth with an image; memory growth; and the node's periods.

    The node needs ROS 2 and runs while one process per core keeps the machine busy.
    """
    from seed_testing.bench.ros import control_rate

    loop = Pressing()
    spent = [loop.step() for _ in range(500 + steps)][500:]
    return {
        **figures("step_{}_us", spent, "median", "mean", "p99"),
        "mode": loop.controller.state.mode,
        "growth_bytes_per_1000_steps": growth(steps),
        "node": control_rate.run(),
    }
