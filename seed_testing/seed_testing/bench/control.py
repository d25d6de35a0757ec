# SPDX-License-Identifier: Apache-2.0
"""What a control step costs, pressing with force, torque and position at once, and how evenly its node runs."""

from __future__ import annotations

import gc
import time
import tracemalloc
from importlib.util import find_spec

import numpy as np

from seed_control.controller import Controller
from seed_control.parameters import ControllerParameters
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import DEFAULT_STIFFNESS, GRAVITY, Hand, Tool
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, pose_from_rpy

DT = 0.004  # [s]
_IMAGES = 6  # steps between images: 42 a second
_FORCE = 10.0  # [N]


class Pressing:
    """A controller that is fed a tool pressed with the wanted force, with noise, sliding along x."""

    def __init__(self, seed: int = 0) -> None:
        self.t, self._count = 0.0, 0
        self._rng = np.random.default_rng(seed)
        tool = Tool()
        self.controller = Controller(ControllerParameters(), Hand(), tool, DEFAULT_STIFFNESS)
        self._X_W_tip = pose_from_rpy((np.pi, 0.0, 0.0), (0.4, 0.0, 0.0))
        self._X_WE = self._X_W_tip @ inverse_pose(tool.X_Ttip) @ inverse_pose(Hand().X_EC)
        lift = (_FORCE - tool.mass * GRAVITY) / DEFAULT_STIFFNESS.translation[2]
        self._X_CT = make_pose(None, (0.0, 0.0, -lift))  # z out of the flange: the pressed tool goes back
        self._feed()
        self.controller.step(self.t)
        self.controller.enable(self.t)
        resists = (True, False, False)
        self._setpoint = HybridSetpoint(
            self._X_W_tip,
            Wrench(np.zeros(3), np.array((0.0, 0.0, -_FORCE))),
            np.diag((0.0, 0.0, 1.0)),
            torque_axes=resists,
            contact_resists=resists,
        )

    def _feed(self) -> None:
        self.controller.add_kinematics(self.t, self._moved(self._X_WE))
        if self._count % _IMAGES == 0:
            X_CT = self._X_CT.copy()
            X_CT[:3, 3] += 3e-4 * self._rng.standard_normal(3)
            self.controller.add_estimate(RelativePoseEstimate(self.t, X_CT))

    def _moved(self, X: Array) -> Array:
        out = X.copy()
        out[0, 3] += 0.05 * np.sin(self.t)
        return out

    def step(self) -> float:
        """One step with its inputs and a set-point that moves; CPU time of the controller's step alone [s]."""
        self.t, self._count = self.t + DT, self._count + 1
        self._feed()
        velocity = np.array((0.05 * np.cos(self.t), 0.0, 0.0))
        self.controller.set_setpoint(self._setpoint.moved(self._moved(self._X_W_tip), velocity), self.t)
        began = time.thread_time()
        self.controller.step(self.t)
        return time.thread_time() - began


def growth(steps: int) -> float:
    """Bytes by which the memory in use grows per 1000 steps, once warm."""
    loop = Pressing()
    tracemalloc.start()
    try:
        for _ in range(600):  # more than the history holds: all that lives on has been traced from its birth
            loop.step()
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(steps):
            loop.step()
        gc.collect()
        return (tracemalloc.get_traced_memory()[0] - before) * 1e3 / steps
    finally:
        tracemalloc.stop()


def run(steps: int = 5000) -> dict[str, object]:
    """Cost of a step [us], CPU time of this thread, every sixth with an image; memory growth; and the node's periods.

    The node needs ROS 2 and runs while one process per core keeps the machine busy.
    """
    loop = Pressing()
    for _ in range(500):
        loop.step()
    spent = [1e6 * loop.step() for _ in range(steps)]
    return {
        "step_median_us": float(np.median(spent)),
        "step_mean_us": float(np.mean(spent)),
        "step_p99_us": float(np.percentile(spent, 99)),
        "mode": loop.controller.state.mode,
        "growth_bytes_per_1000_steps": growth(steps),
        "node": _node(),
    }


def _node() -> object:
    if find_spec("rclpy") is None:
        return "needs ROS 2"
    from seed_testing.bench import control_node as loop_bench_node

    return loop_bench_node.run()
