# SPDX-License-Identifier: Apache-2.0
"""What the soft grasp does to the tool in the plant, where it is not Drake's own bushing."""

from typing import Protocol

from seed_core.spatial import Array, Wrench


class GraspForce(Protocol):
    """A grasp whose wrench the plant asks for at every (sub-)step."""

    def wrench(self, X_TC: Array, V_TC: Array, t: float) -> Wrench:
        """Load on the tool about T's origin, in T.

        Args:
            X_TC: (4, 4) pose of C in T.
            V_TC: (6,) velocity of C in T: angular [rad/s], then that of C's origin [m/s], written in T.
            t: [s] of the plant; steps rise.
        """
        ...
