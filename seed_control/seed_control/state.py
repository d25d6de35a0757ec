# SPDX-License-Identifier: Apache-2.0
"""What the controller tells about itself after each step."""

from __future__ import annotations

from typing import Literal, NamedTuple

from seed_core.spatial import Array, Wrench

Mode = Literal["disabled", "holding", "idle", "position", "approach", "contact"]
MODES = ("disabled", "holding", "idle", "position", "approach", "contact")


class Counters(NamedTuple):
    """Inputs that were refused or left unused since start, each by its cause."""

    setpoints_refused: int = 0
    estimates_invalid: int = 0
    estimates_out_of_order: int = 0
    estimates_unmatched: int = 0
    kinematics_refused: int = 0
    contacts_lost: int = 0
    holds: int = 0


class Journal:
    """What has been counted, and the last remark: one for all parts of a controller."""

    def __init__(self, note: str) -> None:
        self.counters, self.note = Counters(), note

    def count(self, name: str, note: str | None = None) -> None:
        """One more of a counter, with a remark."""
        self.counters = self.counters._replace(**{name: getattr(self.counters, name) + 1})
        if note is not None:
            self.note = note


class ControllerState(NamedTuple):
    """A picture of the controller at one step.

    Attributes:
        mode: disabled; holding (latched, see reason); idle (enabled, no set-point); position (no force direction);
            approach (walking towards contact); contact.
        desired, estimated: wrench of the tool on the environment about the tip, in the task frame [N m, N]; None when
            nothing is asked, or no estimate has come yet. `estimated` is the newest image's, unfiltered.
        filtered: the estimate averaged over about a tenth of a second.
        desired_X_TC, measured_X_CT: displacement that is asked for, and the newest estimate (4, 4).
        X_W_tip: measured pose of the tip at the newest image (4, 4).
        R_W_task: (3, 3) of the task frame in which the wrenches are written.
        limits_hit: names of the limits that shaped this step's target.
        reason: why it holds or is disabled, or the last refusal.
        settled: in contact, and each wanted force within a tenth (at least 0.3 N) of the filtered estimate.
        image_age: now - stamp of the newest estimate [s]; infinite before one.
    """

    stamp: float
    mode: Mode
    enabled: bool
    setpoint_kind: str
    desired: Wrench | None
    estimated: Wrench | None
    filtered: Wrench | None
    desired_X_TC: Array | None
    measured_X_CT: Array | None
    X_W_tip: Array | None
    R_W_task: Array
    limits_hit: tuple[str, ...]
    reason: str
    in_contact: bool
    settled: bool
    image_age: float
    counters: Counters


class ControlOutput(NamedTuple):
    """One step's result: the flange pose to send, X_WE (4, 4), or None before any kinematics; and the state."""

    X_WE: Array | None
    state: ControllerState
