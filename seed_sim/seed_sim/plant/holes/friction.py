# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of many contact points that can stick: a stiff spring across the normal, which slides at mu N.

P. A. Cundall, O. D. L. Strack, "A discrete numerical model for granular assemblies", Geotechnique 29, 1979. Friction
that is a function of the sliding speed alone would let a wedged peg creep.
"""

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array

_SHARE = 0.8  # stiffness across the normal, of that along it
_DAMPING = 2.0  # [N s/m] of each point across the normal


class StickSlip:
    """The springs of n points; those that do not touch have none.

    Attributes:
        stretch: (n, 3) [m], across each point's normal.
    """

    def __init__(self, points: int, friction: float, stiffness: float) -> None:
        """friction: Coulomb's. stiffness: [N/m] along the normal of a point."""
        self._friction, self._stiffness = friction, _SHARE * stiffness
        self.stretch = np.zeros((points, 3))

    def restart(self) -> None:
        """Nothing touches."""
        self.stretch[:] = 0.0

    def force(self, on: NDArray[np.intp], normal: Array, across: Array, load: Array, dt: float) -> Array:
        """On the points (m, 3) [N]; all others let go.

        Args:
            on: (m,) indices of the points that touch. normal: (m, 3) of each.
            across: (m, 3) velocity across the normal [m/s]. load: (m,) along it [N]. dt: [s] since the last call.
        """
        s = self.stretch[on] + dt * across
        s -= (s * normal).sum(axis=1)[:, None] * normal
        pull = -self._stiffness * s - _DAMPING * across
        size, most = np.sqrt((pull * pull).sum(axis=1)), self._friction * load
        share = np.minimum(most / np.maximum(size, 1e-12), 1.0)[:, None]
        pull *= share
        self.stretch[:] = 0.0
        # A spring that slides keeps what it pulls with.
        self.stretch[on] = np.where(share < 1.0, -(pull + _DAMPING * across * share) / self._stiffness, s)
        return pull
