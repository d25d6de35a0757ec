# SPDX-License-Identifier: Apache-2.0
"""What the controller tells about itself after each step."""

from math import inf
from typing import Literal, NamedTuple

import numpy as np

from seed_core.spatial import Array, Wrench

Mode = Literal["disabled", "holding", "idle", "position", "approach", "contact"]


class EventCounts(NamedTuple):
    """Inputs that were refused or left unused since start, each by its cause."""

    setpoints_refused: int = 0
    estimates_invalid: int = 0
    estimates_out_of_order: int = 0
    estimates_unmatched: int = 0
    kinematics_refused: int = 0
    contacts_lost: int = 0
    holds: int = 0


class EventLog:
    """Counts what happens in one controller, and keeps the newest remark on each kind of input.

    A remark lasts until an input of its kind is used again. A counter is named by that kind and what became of it, as
    'setpoints_refused' is.
    """

    def __init__(self, remark: str) -> None:
        self.counters = EventCounts()
        self._remarks: dict[str, str] = {}  # by kind of input, the newest last
        self.restart(remark)

    @property
    def remark(self) -> str:
        """The newest that still holds; '' for none."""
        return next(reversed(self._remarks.values()), "")

    def restart(self, remark: str) -> None:
        """Enabled or disabled: all former remarks are over."""
        self._remarks = {"mode": remark} if remark else {}

    def count(self, name: str, remark: str | None = None) -> None:
        """One more of a counter, with a remark on its kind."""
        self.counters = self.counters._replace(**{name: getattr(self.counters, name) + 1})
        if remark:
            self.say(name.split("_")[0], remark)

    def say(self, kind: str, remark: str) -> None:
        """A remark on the newest input of a kind: setpoints, estimates, kinematics."""
        self._remarks.pop(kind, None)
        self._remarks[kind] = remark

    def used(self, kind: str) -> None:
        """An input of this kind was used: its remark is over."""
        self._remarks.pop(kind, None)


class ControllerState(NamedTuple):
    """A picture of the controller at one step.

    Attributes:
        mode: disabled; holding (latched, see reason); idle (enabled, no set-point); position (no force direction);
            approach (towards contact); contact.
        desired, estimated: wrench of the tool on the environment about the tip, in the task frame [N m, N]; None when
            nothing is asked, or no estimate has come yet. `estimated` is the newest image's, unfiltered.
        filtered: the estimate averaged over about a tenth of a second.
        model_spring: load of the spring on the tool at that image, about T's origin in T, as the model has it.
        deviation: standard deviations of `estimated` [N m, N], of an image of the last tenth of a second.
        covariance: (6, 6) of the same wrench's (torque, force), about the tip in W.
        doubt: what the wrench model finds doubtful of it.
        contradictions: what else is known and does not agree with the wrench, each in words.
        measured_X_CT: displacement of the newest estimate (4, 4).
        X_W_tip: measured pose of the tip at the newest image (4, 4).
        trailing: angle [rad] at the newest image by which the tip trails along the path, but for what torque turns;
            None where the law does not bring the tool upright, or nothing is followed.
        R_W_task: (3, 3) of the task frame in which the wrenches are written.
        limits_hit: names of the limits that shaped this step's target.
        reason: why it holds or is disabled; else what the newest input was refused for, until one of its kind is used;
            else what is worth telling of the contact.
        settled: in contact, and each wanted force within a tenth (at least 0.3 N) of the filtered estimate.
        image_age: now - stamp of the newest estimate [s]; infinite before one.
    """

    stamp: float
    mode: Mode
    enabled: bool
    setpoint_kind: str = ""
    desired: Wrench | None = None
    estimated: Wrench | None = None
    filtered: Wrench | None = None
    model_spring: Wrench | None = None
    deviation: Wrench | None = None
    covariance: Array | None = None
    contradictions: tuple[str, ...] = ()
    doubt: str = ""
    measured_X_CT: Array | None = None
    X_W_tip: Array | None = None
    trailing: float | None = None
    R_W_task: Array = np.eye(3)
    limits_hit: tuple[str, ...] = ()
    reason: str = ""
    in_contact: bool = False
    settled: bool = False
    image_age: float = inf
    counters: EventCounts = EventCounts()


class ControlOutput(NamedTuple):
    """One step's result: the flange pose to send, X_WE (4, 4), or None before any kinematics; and the state."""

    X_WE: Array | None
    state: ControllerState
