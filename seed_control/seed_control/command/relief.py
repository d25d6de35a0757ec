# SPDX-License-Identifier: Apache-2.0
"""Giving way while it holds: where something goes on pressing against a tool that stands still, the gripper retreats.

Only back along the force that was wanted, only by what the estimated force asks for, and never far.
The force is counted from where the gripper was as the image was taken, so that each image may be answered at once.
"""

from seed_core.spatial import Array, length
from seed_core.vector3 import ZERO, Vector3, as_vector3, dot, minus, plus_scaled

_IMAGES = 3  # in a row
_NOISE = 3.0  # deviations of the estimated force


class Relief:
    """`image` with each image, `give_way` while it holds, `target` at every step, `restart` when it is enabled."""

    def __init__(self, most: float, furthest: float) -> None:
        """most: [N] that may be borne beyond the wanted force; furthest: [m] that it retreats."""
        self._most, self._furthest = most, furthest
        self.restart()

    def restart(self) -> None:
        """It moves by itself again."""
        self._back, self.way = ZERO, 0.0
        self._over, self._size, self._pressed = 0.0, 0.0, 0

    def image(self, force: Array, wanted: Array, deviation: float) -> None:
        """Take in an image, while it moves as well: what made it hold has been seen when it comes to hold.

        Args:
            force, wanted: of the tool on the environment (3,) [N] in W. deviation: of a force [N].
        """
        size = length(wanted)
        if size == 0.0:
            self._pressed = 0
            return
        self._back, self._size = as_vector3(-wanted / size), size
        self._over = float(force @ wanted) / size - size
        self._pressed = self._pressed + 1 if self._over > max(self._most, _NOISE * deviation) else 0

    def give_way(self, stiffness: float, place: Array, held_at: Vector3, doubtful: bool) -> None:
        """Retreat, if the last images were pressed.

        Args:
            stiffness: of the grasp [N/m].
            place: of C when the newest image was taken (3,) [m] in W. held_at: where C came to hold [m].
            doubtful: the force may be wrong; then no further than lets go of the wanted force.
        """
        if self._pressed >= _IMAGES:
            gone = dot(self._back, minus(as_vector3(place), held_at))
            furthest = min(self._furthest, self._size / stiffness) if doubtful else self._furthest
            self.way = min(max(self.way, gone + self._over / stiffness), furthest)

    def target(self, held_at: Vector3) -> Vector3:
        """Where C is to go [m], from where it came to hold."""
        return plus_scaled(held_at, self.way, self._back)
