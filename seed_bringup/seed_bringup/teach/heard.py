# SPDX-License-Identifier: Apache-2.0
"""A demonstration out of a controller's messages: pose of the tip and force, one of each image."""

from collections import deque
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from seed_control.teach import Demonstration, Recorder, TeachError
from seed_control.teach.demonstration import SAME
from seed_core.arm.quaternion import to_pose
from seed_core.spatial import Array

STATE, WRENCH = "controller/state", "wrench_estimate"
REMEMBERED = 100  # messages for whose image the other one may still come
SHOWN = 0.1  # [s] of motion, from which a stretch shows something


class _Stretch(NamedTuple):
    """While the controller was enabled, or was not.

    Attributes:
        played: it was enabled, and played what was shown; else it stood by while the arm was led.
    """

    played: bool
    recorder: Recorder

    @property
    def demonstration(self) -> Demonstration | None:
        """From the first motion to the last; None where nothing was measured, or nothing moved or touched."""
        whole = self.recorder.demonstration() if len(self.recorder) > 1 else None
        return whole.moving() if whole is not None and whole.moves else None

    @property
    def duration(self) -> float:
        """[s] of that."""
        shown = self.demonstration
        return 0.0 if shown is None else max(float(shown.stamps[-1] - shown.stamps[0]), 0.0)


class _Tip(NamedTuple):
    """Where the tip was in the image of a stamp [s]."""

    image: float
    X_W_tip: Array
    stretch: _Stretch


class Heard:
    """`take` messages as they come. Of all stretches between enabling and disabling the longest counts.

    Attributes:
        doubt: the first that contradicted a force, in the controller's words.
    """

    def __init__(self, led: bool = False) -> None:
        """led: only stretches count in which the controller was not enabled."""
        self._led = led
        self._stretches: list[_Stretch] = []
        self._tips: deque[_Tip] = deque(maxlen=REMEMBERED)
        self._forces: deque[tuple[float, Array]] = deque(maxlen=REMEMBERED)
        self.doubt = ""

    def take(self, name: str, message: Any) -> None:
        """A message on STATE or WRENCH."""
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if name == STATE:
            if not self._stretches or self._stretches[-1].played != message.enabled:
                self._stretches.append(_Stretch(message.enabled, Recorder()))
            p, q = message.tip.position, message.tip.orientation
            age = message.estimate_age if isfinite(message.estimate_age) else 0.0
            tip = _Tip(stamp - age, to_pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w)), self._stretches[-1])
            self._tips.append(tip)
            for force in [f for f in self._forces if abs(f[0] - tip.image) < SAME]:
                self._forces.remove(force)
                tip.stretch.recorder.add(force[0], tip.X_W_tip, force[1])
            return
        self.doubt = self.doubt or message.reason
        force = stamp, np.array((message.wrench.force.x, message.wrench.force.y, message.wrench.force.z))
        for tip in reversed(self._tips):
            if abs(tip.image - stamp) < SAME:
                tip.stretch.recorder.add(stamp, tip.X_W_tip, force[1])
                return
        self._forces.append(force)

    @property
    def played(self) -> bool:
        """Whether what counts was played."""
        return self._taken is not None and self._taken.played

    @property
    def _taken(self) -> _Stretch | None:
        """The longest; without any motion the one with the most measurements."""
        able = [s for s in self._stretches if not (self._led and s.played)]
        return max(able, key=lambda s: (s.duration, len(s.recorder)), default=None)

    @property
    def choice(self) -> str:
        """Which of several stretches was taken; '' where one alone shows something."""
        shown = [s for s in self._stretches if s.duration > SHOWN]
        if self._taken is None or len(shown) < 2:
            return ""
        told = ", ".join(f"{s.duration:.1f} s {_how(s)}" for s in shown)
        longest = "longest that was led" if self._led else "longest"
        taken = f"{self._taken.duration:.1f} s {_how(self._taken)}"
        return f"of {len(shown)} stretches ({told}) the {longest} was taken, {taken}"

    def demonstration(self) -> Demonstration:
        """What counts, from the first motion to the last. Raises TeachError: nothing has come."""
        taken = self._taken
        if taken is None and self._stretches:
            raise TeachError(
                "the controller was enabled all the while, and --freedrive teaches what is led by hand: disable it"
            )
        if taken is None or not len(taken.recorder):
            raise TeachError(
                f"no pose of the tip with a force came on {STATE} and {WRENCH}: is the tool grasped, and its pose "
                "estimated?"
            )
        return taken.recorder.demonstration().moving()


def _how(stretch: _Stretch) -> str:
    return "played" if stretch.played else "led"
