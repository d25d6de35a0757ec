# SPDX-License-Identifier: Apache-2.0
"""The simulated identification cell as a ROS node: an arm on a fixed force/torque sensor, at real topics."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from seed_msgs.msg import RelativePose
from std_msgs.msg import Float32, Float64
from std_srvs.srv import Trigger

from seed_core.config import field
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import FINGERS, Frame
from seed_core.spatial import Wrench, inverse_pose
from seed_ros import COMMAND, QUEUE, SENSOR, FixedRateLoop, FrameNames, MessageError, SeedNode, diagnostics
from seed_ros.conversions import check_frame, estimate_to_message, pose_stamped, pose_to_matrix, wrench_stamped
from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import load
from seed_sysid.run.procedure import Command


@dataclass(frozen=True)
class CellSettings:
    """Parameters of the simulated cell."""

    scenario: str = field("default", doc="name or file of the identification scenario")
    seed: int = field(0, low=0, high=2**31 - 1, doc="draws the hidden stiffness and every fault")
    rate: float = field(50.0, unit="Hz", low=20.0, high=500.0, doc="of every stream")
    camera_clock: float = field(0.0, unit="s", low=-0.5, high=0.5, doc="by which relative_pose's stamps are ahead")
    flange: Frame = field(Frame((0.45, 0.0, 0.4), (180.0, 0.0, 0.0)), doc="where the flange stands at the grasp")


class CellNode(SeedNode):
    """Gripper, arm, grasp and sensor. The true relative pose stands in for an estimator."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("identification_cell", **arguments)
        self.settings = self.declare(CellSettings())
        self.frames = self.declare(FrameNames(), "frames")
        self.refuse_unknown()

        self.scenario = replace(load(self.settings.scenario), rate=self.settings.rate)
        if self.scenario.grasp.kind == "membrane":
            raise SeedError(
                f"scenario = {self.settings.scenario}: grasp.kind = membrane: this node simulates a bushing only; "
                "./seed identify --scenario FILE simulates membranes, without ROS"
            )
        self.cell = SimulatedCell(self.scenario, self.settings.seed)
        self.widths = np.array(self.scenario.procedure.widths)
        self.width = float(np.median(self.widths))
        self._last, self._zero = np.zeros(6), np.zeros(6)
        self.X_EC, self.X_WE = self.scenario.hand.X_EC, self.settings.flange.pose
        self.X_WT = self.X_WE @ self.X_EC

        create = self.create_publisher
        self._pose = create(PoseStamped, "current_pose", QUEUE)
        self._wrench = create(WrenchStamped, "ft_sensor/wrench", QUEUE)
        self._width = create(Float64, "gripper/width", QUEUE)
        self._relative = create(RelativePose, "relative_pose", QUEUE)
        self._pressure = [create(Float32, f"bubble_{f}/pressure", SENSOR) for f in FINGERS]
        self.loop = FixedRateLoop(self, self.settings.rate, self._tick)
        self.loop.poll(PoseStamped, "target_frame", self._on_target, COMMAND)
        self.loop.poll(Float64, "gripper/command", self._on_width, COMMAND)
        self.serve(Trigger, "ft_sensor/zero", self._set_zero)
        self.diagnose(
            f"scenario {self.scenario.name}", lambda: (diagnostics.OK, "following target_frame", self.counters.values())
        )

    def _on_target(self, message: PoseStamped) -> None:
        try:
            check_frame(message.header.frame_id, (self.frames.base,), "target_frame")
            X_WE = pose_to_matrix(message.pose, "target_frame")
            if float(np.abs(X_WE[:3, 3] - self.X_WE[:3, 3]).max()) > 0.02:
                raise MessageError("target_frame jumps by more than 20 mm")
        except SeedError as error:
            self.counters.add("targets_refused", f"{error}; the arm holds")
        else:
            self.X_WE = X_WE

    def _on_width(self, message: Float64) -> None:
        if np.isfinite(message.data) and message.data >= 0.0:
            self.width = float(message.data)

    def _set_zero(self) -> str:
        self._zero = self._last
        return "the present load now reads as zero"

    def _tick(self) -> None:
        t = self.now()
        self.beats.add()
        grip = int(np.argmin(np.abs(self.widths - self.width)))
        reading = self.cell.step(
            Command(inverse_pose(self.X_WT) @ self.X_WE @ self.X_EC, self.width, grip, "following")
        )
        self._last = reading.wrench
        self._pose.publish(pose_stamped(self.X_WE, t, self.frames.base))
        self._wrench.publish(wrench_stamped(Wrench.from_vector(reading.wrench - self._zero), t, "ft_sensor"))
        self._width.publish(Float64(data=self.width))
        for publisher, value in zip(self._pressure, reading.pressures, strict=True):
            publisher.publish(Float32(data=value))
        seen = t + self.settings.camera_clock
        estimate = RelativePoseEstimate(seen, inverse_pose(reading.X_TC), method="kinematics")
        self._relative.publish(estimate_to_message(estimate, self.frames.compliance, self.frames.tool))


main = CellNode.main
