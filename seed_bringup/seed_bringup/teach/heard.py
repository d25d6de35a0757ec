# SPDX-License-Identifier: Apache-2.0
"""A demonstration out of a controller's messages: pose of the tip and force, one of each image."""

from typing import Any

import numpy as np

from seed_control.teach import Demonstration, Recorder, TeachError
from seed_core.arm.quaternion import to_pose
from seed_core.spatial import Array

STATE, WRENCH = "controller/state", "wrench_estimate"


class Heard:
    """`take` messages as they come.

    A controller that was enabled at any time has played what was shown, and its longest stretch counts; one that never
    was stood by while the arm was led.

    Attributes:
        doubt: the first that contradicted a force, in the controller's words.
    """

    def __init__(self) -> None:
        self._tip: Array | None = None
        self._led = Recorder()
        self._played: list[Recorder] = []
        self._enabled = False
        self.doubt = ""

    def __len__(self) -> int:
        return len(self._recorder)

    @property
    def played(self) -> bool:
        """Whether the controller was enabled."""
        return bool(self._played)

    @property
    def _recorder(self) -> Recorder:
        return max(self._played, key=len) if self._played else self._led

    def take(self, name: str, message: Any) -> None:
        """A message on STATE or WRENCH."""
        if name == STATE:
            if message.enabled and not self._enabled:
                self._played.append(Recorder())
            self._enabled = message.enabled
            p, q = message.tip.position, message.tip.orientation
            self._tip = to_pose((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        elif self._tip is not None:  # a force is sent right after the state of its moment
            self.doubt = self.doubt or message.reason
            f, stamp = message.wrench.force, message.header.stamp
            recorder = self._played[-1] if self._enabled else self._led
            recorder.add(stamp.sec + 1e-9 * stamp.nanosec, self._tip, np.array((f.x, f.y, f.z)))

    def demonstration(self) -> Demonstration:
        """All that counts, from the first motion to the last. Raises TeachError: nothing has come."""
        if not len(self):
            raise TeachError(
                f"no pose of the tip with a force came on {STATE} and {WRENCH}: is the tool grasped, and its pose "
                "estimated?"
            )
        return self._recorder.demonstration().moving()
