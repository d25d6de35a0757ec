# SPDX-License-Identifier: Apache-2.0
"""The grip that answers slip, as a part of the controller's node: margin out, a width or a force to the gripper."""

from collections import deque
from math import inf, isfinite, nan

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from std_msgs.msg import Float64

from seed_control.controller import Controller
from seed_control.grip import GripControl, GripSettings, KeptLoad, Margin, SlipMargin, SlipSigns, signs_of
from seed_core.estimate import NEW_GRASP, RelativePoseEstimate
from seed_core.spatial import Array, Wrench, both
from seed_ros import COMMAND, QUEUE, SeedNode, diagnostics

SEND = 0.01  # [s] between commands
STATUS = 0.2  # [s] between two of ~/grip
_KEPT = 30  # images, until they are matched with the arm
_SHARE = 0.1  # of the load that a stiffness map leaves unknown


class GripAnswer:
    """Listens to gripper/width and gripper/force, publishes slip_margin and, where allowed, what the gripper is to do.

    Attributes:
        hold: why the arm has to hold; '' for nothing.
    """

    def __init__(self, node: SeedNode, core: Controller, settings: GripSettings) -> None:
        self._node, self._core, self._settings = node, core, settings
        self.hold = ""
        self._margin, self._control, self._kept = SlipMargin(settings), GripControl(settings), KeptLoad()
        self._width = self._force = nan
        self._signs: deque[tuple[float, SlipSigns]] = deque(maxlen=_KEPT)  # by stamp [s]
        # Of the last image: load in C, its covariance, and the grip [N]
        self._load: tuple[Wrench, Array, float] | None = None
        self._image = self._sent = self._width_heard = self._force_heard = -inf  # [s]
        self._told = node.publisher(Float64, "slip_margin", QUEUE)
        self._status = node.publisher(DiagnosticStatus, "~/grip", COMMAND)
        self._status_told = -inf  # [s]
        node.loop.poll(Float64, "gripper/width", self._on_width, QUEUE)
        node.loop.poll(Float64, "gripper/force", self._on_force, QUEUE)
        if settings.command == "off":
            return
        topic = "gripper/command" if settings.command == "width" else "gripper/force_command"
        self._command = node.publisher(Float64, topic, COMMAND)

    def _on_width(self, message: Float64) -> None:
        self._width, self._width_heard = message.data, self._node.now()

    def _on_force(self, message: Float64) -> None:
        """A gripper is heard by both: one that tells no width any more is silent."""
        self._force_heard = now = self._node.now()
        self._force = message.data
        if 0.0 <= now - self._width_heard <= self._settings.answer_time:
            self._control.heard(now, self._width, self._force)

    def estimate(self, estimate: RelativePoseEstimate) -> None:
        """What an estimate tells of slip, valid or not, with what the tool has slid on its membranes still in it."""
        now, signs = self._node.now(), signs_of(estimate)
        if NEW_GRASP in estimate.reason:
            self._margin.restart()
            self._kept.restart()
            self._load = None
        elif estimate.gross_slip:
            self._control.slipped(now, estimate.stamp)
            if self._load is not None:  # it was more than friction bears
                self._status_told = -inf  # told at once
                self._update(now, estimate.stamp, *self._load, signs)
                self._load = None
        elif estimate.valid:
            self._signs.append((estimate.stamp, signs))
            self._control.sticks()

    def after_step(self, now: float) -> None:
        """Take in a new measurement, tell the margin, and send the gripper what it is to do; now [s]."""
        m = self._core.law.measured
        if m is not None and m.stamp != self._image and m.estimate is not None and isfinite(self._force):
            self._image = m.stamp
            estimator = self._core.wrench_estimator
            load = m.model_spring
            if self._settings.load_kept and estimator.model.name == "bushing":
                load = self._kept.update(load, estimator.bushing.stiffness, m.X_TC)
            C = estimator.covariance(m)[1] + np.diag((_SHARE * load.vector()) ** 2)
            R = m.X_CT[:3, :3]
            in_C = both(R) @ C @ both(R).T
            self._load = load.rotated(R), in_C, self._force
            signs = next((s for stamp, s in self._signs if stamp == m.stamp), SlipSigns())
            self._update(now, m.stamp, *self._load, signs)
        if self._settings.command == "off":
            return
        enabled = self._core.state.enabled
        if not enabled:
            self._control.rest(now)
        command = self._control.command(now)
        self.hold = command.hold
        if not enabled:
            return
        if command.hold:
            self._core.hold(now, command.hold)
        wanted = command.width if self._settings.command == "width" else command.force
        if isfinite(wanted) and not 0.0 <= now - self._sent < SEND:
            self._sent = now
            self._command.publish(Float64(data=wanted))

    def _update(
        self, now: float, stamp: float, load: Wrench, covariance: Array, force: float, signs: SlipSigns
    ) -> None:
        """The margin at an image, of a load in C, told and answered."""
        margin = self._margin.update(stamp, load, covariance, force, signs)
        self._control.image(margin, now)
        if 0.0 <= now - self._force_heard <= self._settings.answer_time:  # a margin of an old grip is none
            self._told.publish(Float64(data=margin.value))
        self._tell(margin, now)

    def _tell(self, margin: Margin, now: float) -> None:
        """All that is known of the grip, some times a second."""
        if 0.0 <= now - self._status_told < STATUS:
            return
        self._status_told = now
        level = diagnostics.WARN if self.hold else diagnostics.OK
        status = DiagnosticStatus(name=f"{self._node.get_fully_qualified_name()}: grip", hardware_id="gripper")
        status.level, status.message = level, self.hold or f"slip margin {margin.value:.2f}"
        values = {
            "margin": margin.value, "margin_deviation": margin.deviation, "load_N": margin.load,
            "friction": margin.friction, "grip_N": self._force, "wanted_N": self._control.wanted,
        }  # fmt: skip
        status.values = [KeyValue(key=key, value=f"{value:.4g}") for key, value in values.items()]
        self._status.publish(status)
