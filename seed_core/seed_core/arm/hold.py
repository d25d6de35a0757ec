# SPDX-License-Identifier: Apache-2.0
"""The latched hold of an arm and of a controller: clauses 3 to 6 of docs/arm_contract.md."""

UNTOLD = "held for a reason that was not told"


class HoldLatch:
    """Targets are followed until something is wrong, then not any more until `resume`, whatever comes meanwhile.

    Whoever owns the motion asks `following` (or `reason`) at every step and decelerates to rest while it holds:

    - `heard(now)` with every usable target, `refused(why)` with any other, `check(now)` at every step for silence;
    - `hold(why)` for what ends the motion whatever the targets are: a stop on request, a robot that cannot move,
      a stale estimate in the controller;
    - `resume()` for the service that lets it go on, from where the arm stands. Its first target starts the motion.

    Simulation and target guard do all of these. The driver's servo process looks for silence by the robot's clock
    and gives that as `now`. The controller has no stream of targets of its own: it holds, resumes and never checks.

    Attributes:
        reason: why it holds, or what it waits for; empty while targets are accepted.
    """

    def __init__(self, patience: float, reason: str = "") -> None:
        """Accept targets at once, unless a reason to wait is given.

        Args:
            patience: [s] without a usable target, once there has been one, that is a hold.
            reason: what the first `resume` is waited for.
        """
        self.patience = patience
        self.reason = reason
        self._heard: float | None = None  # [s] when the last usable target came; None: none to follow yet

    @property
    def following(self) -> bool:
        """Whether it goes to targets: there has been one since it was resumed."""
        return self._heard is not None and not self.reason

    def heard(self, now: float) -> None:
        """A usable target has come at `now` [s]. While it holds, none is usable."""
        if not self.reason:
            self._heard = now

    def refused(self, why: str) -> None:
        """A target was refused: what is being followed is not followed any more."""
        if self.following:
            self.hold(why)

    def check(self, now: float, why: str = "") -> None:
        """Hold when no target has come for too long; why: what is known of the cause. Without a first one it waits."""
        if self._heard is not None and now - self._heard > self.patience:
            self.refused(f"no target_frame for {self.patience:g} s" + (f" ({why})" if why else ""))

    def hold(self, why: str) -> None:
        """Follow nothing from now on; the newest reason is the one that is told. An error without words holds, too."""
        self.reason, self._heard = why or UNTOLD, None

    def resume(self) -> None:
        """Follow the targets that come from now on."""
        self.reason, self._heard = "", None
