# SPDX-License-Identifier: Apache-2.0
"""The stiffness follows the grip: pressures or width in, a new stiffness for the controller out."""

from collections.abc import Callable
from functools import partial

from std_msgs.msg import Float32, Float64

from seed_control.ros.bubble_pressures import OLDEST
from seed_control.wrench.stiffness_schedule import ScheduleSettings, StiffnessSchedule
from seed_core.bushing import Stiffness
from seed_core.hand import FINGERS
from seed_core.stiffness_file import GripStiffness, load_stiffness
from seed_ros import QUEUE, SENSOR, SeedNode


class StiffnessScheduleInput:
    """Subscribes to what tells the grip and calls `apply` with each new stiffness."""

    def __init__(self, node: SeedNode, settings: ScheduleSettings, apply: Callable[[Stiffness], None]) -> None:
        self._node, self._apply = node, apply
        self._pressures: dict[str, tuple[float, float]] = {}  # when it came [s] and value [hPa], by finger
        if not settings.file:
            return
        self._schedule = StiffnessSchedule(GripStiffness(load_stiffness(settings.file)), settings.follow)
        if settings.follow == "width":
            node.loop.poll(Float64, "gripper/width", lambda message: self._update(message.data), QUEUE)
            return
        for finger in FINGERS:
            receive = partial(self._on_pressure, finger)
            node.loop.poll(Float32, f"bubble_{finger}/pressure", receive, SENSOR)

    def _on_pressure(self, finger: str, message: Float32) -> None:
        """The identification is over the mean of both bubbles: while one is silent the stiffness stays as it is."""
        now = self._node.now()
        self._pressures[finger] = now, message.data
        for other, (heard, _) in self._pressures.items():
            if now - heard >= OLDEST:
                silent = f"no pressure of the {other} bubble for {OLDEST:g} s: the stiffness stays as it is"
                self._node.counters.add("grip_unreadable", silent)
                return
        if len(self._pressures) == len(FINGERS):
            self._update(sum(value for _, value in self._pressures.values()) / len(FINGERS))

    def _update(self, value: float) -> None:
        with self._node.counters.refusing("grip_unreadable"):
            stiffness = self._schedule.update(value)
            if stiffness is not None:
                self._apply(stiffness)
