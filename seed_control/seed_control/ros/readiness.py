# SPDX-License-Identifier: Apache-2.0
"""`~/ready`: whether a set-point or a task would be followed, and what is missing, to the person at the arm."""

from collections.abc import Callable, Mapping
from math import inf
from time import monotonic

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from seed_control.controller import Controller
from seed_ros import LATCHED, SeedNode, diagnostics

EVERY = 0.5  # [s] between two looks
PATIENCE = 15.0  # [s] by the machine's clock for the cell to be up, before it is told what it waits for


class Readiness:
    """Publishes when what is missing changes; latched, so that whoever asks later is told as well.

    Logs once that the cell is up, and before, if that takes long, what it waits for.
    """

    def __init__(
        self, node: SeedNode, core: Controller, arm_holds: Callable[[], str], skewed: Callable[[], str]
    ) -> None:
        """Publish from now on.

        Args:
            arm_holds: why what moves the arm follows nothing; '' while it follows.
            skewed: what is wrong with the estimator's clock; '' for nothing.
        """
        self._core, self._arm_holds, self._skewed = core, arm_holds, skewed
        self._name = node.get_fully_qualified_name()
        self._pose = node.resolve_topic_name("current_pose")  # as it is called here
        self._publisher = node.publisher(DiagnosticStatus, "~/ready", LATCHED)
        self._looked = -inf  # [s]
        self._told: tuple[str, ...] | None = None
        self._log, self._began = node.get_logger(), monotonic()
        self._up = self._late = False

    def look(self, now: float, at_once: bool = False) -> None:
        """Tell what has changed, if it is time or to be told at once; now [s]."""
        if not at_once and 0.0 <= now - self._looked < EVERY:
            return
        self._looked = now
        parts = self.missing(now)
        if not self._up:
            self._log_start(parts)
        told = tuple(_without_numbers(words) for words in parts.values())
        if told != self._told:
            self._told = told
            self._publisher.publish(self._status(parts))

    def _log_start(self, parts: Mapping[str, str]) -> None:
        """Once what is missing as the cell is up, and that it is not yet."""
        if self._core.heard:
            self._up = True
            self._log.info(f"the cell is up; {self._status(parts).message}")
        elif not self._late and monotonic() - self._began > PATIENCE:
            self._late = True
            self._log.warning(f"the cell is not up after {PATIENCE:g} s; {self._status(parts).message}")

    def missing(self, now: float) -> dict[str, str]:
        """What is missing, by the part that is to deliver it; '' for what is there."""
        state, parts = self._core.state, {"arm": self._arm_holds(), **self._core.missing(now)}
        parts["estimate"] = self._skewed() or parts["estimate"]
        parts["pose"] = parts["pose"].replace("(current_pose)", f"({self._pose})")
        if not state.enabled:
            parts["controller"] = "not enabled: call controller/enable on"
        else:
            parts["controller"] = f"holds: {state.reason}; call controller/enable on" if state.mode == "holding" else ""
        return parts

    def _status(self, parts: Mapping[str, str]) -> DiagnosticStatus:
        lacks = "; ".join(filter(None, parts.values()))
        clocks = self._core.checks.why_no_force
        status = DiagnosticStatus(name=self._name, hardware_id="cell")
        status.level = diagnostics.WARN if lacks else diagnostics.OK
        ready = f"ready for positions; no force: {clocks}" if clocks else "ready: send a set-point or a task"
        status.message = f"not ready: {lacks}" if lacks else ready
        status.values = [KeyValue(key=part, value=words) for part, words in (*parts.items(), ("force", clocks))]
        return status


def _without_numbers(words: str) -> str:
    """A cause that lasts is told once, though its age in it grows."""
    return "".join(c for c in words if not c.isdigit())
