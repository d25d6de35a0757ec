# SPDX-License-Identifier: Apache-2.0
"""The load of a grasp whose grip changes while it bears something.

Membranes that close further on a tool touch it with more of their sheet, and what touches anew bears nothing yet: the
load stays, the stiffness for what comes on top has grown. K x with the new stiffness would tell a load that is not
there (six times too much, for a grip that was tripled under a pull). So the load is carried over at each change:

    w = K x - w0,    w0 grows by (K - K_before) x at each change.
"""

import numpy as np

from seed_core.bushing import Bushing, Stiffness
from seed_core.spatial import Array, Wrench


class KeptLoad:
    """One grasp; `restart` with a new one."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """No load was carried over yet."""
        self._of: Stiffness | None = None
        self._offset = Wrench.zero()

    def update(self, spring: Wrench, stiffness: Stiffness, X_TC: Array) -> Wrench:
        """The load on the tool about T's origin, in T.

        Args:
            spring: by the stiffness in use. stiffness: that is. X_TC: (4, 4).
        """
        before, self._of = self._of, stiffness
        if before is not None and not np.array_equal(before.vector(), stiffness.vector()):
            grown = Bushing(stiffness).wrench(X_TC).minus(Bushing(before).wrench(X_TC))
            self._offset = self._offset.plus(grown)
        return spring.minus(self._offset)
