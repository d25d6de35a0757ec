# SPDX-License-Identifier: Apache-2.0
"""The stiffness follows the grip: pressures or width in, a new stiffness for the controller out."""

from collections.abc import Callable
from functools import partial

from std_msgs.msg import Float32, Float64

from seed_control.monitor.pressure_check import why_off
from seed_control.ros.bubble_pressures import OLDEST
from seed_control.wrench.choose_model import same_hand
from seed_control.wrench.stiffness_schedule import ScheduleFollower, ScheduleSettings
from seed_core.bushing import Stiffness
from seed_core.hand import FINGERS, Hand
from seed_core.stiffness_file import GripStiffness, load_stiffness
from seed_ros import QUEUE, SENSOR, SeedNode


class StiffnessScheduleInput:
    """Subscribes to what tells the grip and calls `apply` with each new stiffness."""

    def __init__(
        self, node: SeedNode, settings: ScheduleSettings, hand: Hand, apply: Callable[[Stiffness], None]
    ) -> None:
        """Raises ConfigError: the file cannot be read, is of another hand, or does not tell what is to be followed."""
        self._node, self._apply = node, apply
        self._pressures: dict[str, tuple[float, float]] = {}  # when it came [s] and value [hPa], by finger
        if not settings.file:
            return
        file = load_stiffness(settings.file)
        same_hand(settings.file, file.hand, hand)
        self._schedule = ScheduleFollower(GripStiffness(file), settings.follow)
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
        for other, (heard, pressure) in self._pressures.items():
            why = why_off(other, pressure, self._schedule.pressures)
            if not 0.0 <= now - heard < OLDEST:
                why = f"no pressure of the {other} bubble for {OLDEST:g} s"
            if why:
                self._node.counters.add("grip_unreadable", f"{why}: the stiffness stays as it is")
                return
        if len(self._pressures) == len(FINGERS):
            self._update(sum(value for _, value in self._pressures.values()) / len(FINGERS))

    def _update(self, value: float) -> None:
        with self._node.counters.refusing("grip_unreadable"):
            stiffness = self._schedule.update(value)
            if stiffness is not None:
                self._apply(stiffness)
