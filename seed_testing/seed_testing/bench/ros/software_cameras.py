# SPDX-License-Identifier: Apache-2.0
"""The node `cameras` on two software devices that are fed at 30 Hz; the right one can be unplugged."""

import sys
import threading
import time
from typing import Any

import numpy as np
from std_srvs.srv import SetBool

from seed_core.hand import Hand
from seed_estimation.realsense.software import UNIT, SoftwareCamera
from seed_estimation.ros.cameras import CamerasNode
from seed_ros.node import run
from seed_sim.tactile import TactileRenderer
from seed_sim.tactile.parameters import TactileParameters

RATE = 30.0  # [Hz]
PICTURES = 3  # that are played over and over


class SoftwareCamerasNode(CamerasNode):
    """The node as it is, with cameras that are plugged in by ~/unplug."""

    def __init__(self, **arguments: Any) -> None:
        renderer = TactileRenderer(TactileParameters(camera="d405"), Hand(), 0)
        drawn = [renderer.render(np.eye(4), k / RATE) for k in range(PICTURES)]
        self._there = {
            f: SoftwareCamera(str(k), camera) for k, (f, camera) in enumerate(sorted(renderer.cameras.items()))
        }
        self._pictures = [
            {
                f: (np.rint(np.nan_to_num(i.depth) / UNIT).astype(np.uint16), np.clip(i.ir, 0, 255).astype(np.uint8))
                for f, i in p.items()
            }
            for p in drawn
        ]
        self._plugged = dict.fromkeys(self._there, True)
        super().__init__(find=lambda: [c.device for f, c in self._there.items() if self._plugged[f]], **arguments)
        self.serve(SetBool, "~/unplug", self._unplug)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._feed, daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """End the feeding first."""
        self._over.set()
        self._thread.join()
        super().destroy_node()

    def _unplug(self, away: bool) -> str:
        self._plugged["right"] = not away
        return ""

    def _feed(self) -> None:
        due, k = time.monotonic(), 0
        while not self._over.wait(max(0.0, due - time.monotonic())):
            due, k = due + 1.0 / RATE, k + 1
            for finger, camera in self._there.items():
                if self._plugged[finger]:
                    camera.show_raw(*self._pictures[k % PICTURES][finger], time.time())


def main() -> int:
    """Run the node."""
    return run(SoftwareCamerasNode)


if __name__ == "__main__":
    sys.exit(main())
