# SPDX-License-Identifier: Apache-2.0
"""Whether the simulated arm follows its targets: clauses 3 to 6 of docs/arm_contract.md."""

from __future__ import annotations


class Latch:
    """Follows from the start; holds from a refusal or silence on, with `reason`, until `resume`."""

    def __init__(self, patience: float) -> None:
        """patience: [s] without a usable target that is a hold."""
        self._patience = patience
        self.reason = ""  # why it holds; empty while it follows
        self._heard: float | None = None  # [s] when the last usable target came; None: none to follow yet

    @property
    def following(self) -> bool:
        """Whether there are targets, and it goes to them."""
        return self._heard is not None and not self.reason

    def heard(self, now: float) -> None:
        """A usable target came at `now` [s]."""
        self._heard = now

    def refused(self, reason: str) -> None:
        """A target was refused: what is being followed is not followed any more."""
        if self._heard is not None and not self.reason:
            self.reason = reason

    def check(self, now: float) -> None:
        """Hold when no target has come for too long."""
        if self._heard is not None and now - self._heard > self._patience:
            self.refused(f"no target_frame for {self._patience:g} s")

    def resume(self) -> None:
        """Follow the targets that come from now on."""
        self.reason, self._heard = "", None
