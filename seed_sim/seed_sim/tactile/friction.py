# SPDX-License-Identifier: Apache-2.0
"""Stick and slip between tool and membrane: how far the membrane follows the tool, and how far the tool slides.

The membrane is a spring against sideways motion of the patch. It moves with the tool until the load reaches what
friction bears; then it springs back to what sliding friction bears, stays there, pulled along the way the tool slides,
and sticks again when the tool stops (Coulomb's law with a smaller kinetic coefficient, as a return map).
"""

import math
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array, inverse_pose, so3_log
from seed_sim.tactile.membrane import followed

_SPRING_BACK = 0.008  # [s] in which the membrane's excess load decays by e: it is light and well damped
_TWIST = 2.0  # a patch that turns strains the sheet around it so much more, per motion of its edge, than one that moves


class Held(NamedTuple):
    """Effect of friction at one time.

    Attributes:
        X_slid: (4, 4) how far the tool has slid through the membrane since the grasp.
        load: share of the largest load that friction bears, 0 to 1; 1 while the tool slides.
        sliding: whether it slides.
    """

    X_slid: Array
    load: float
    sliding: bool


class Friction:
    """State of one grasp, from X_CT = identity on."""

    def __init__(self, hold: float, kinetic: float, reach: float) -> None:
        """hold [m]: displacement at which the tool breaks loose; reach [m]: rms distance of the patch from its middle;
        kinetic: share of `hold` that is left while it slides."""
        self.hold, self._kinetic, self._reach = hold, kinetic, reach
        self._X_CT = self._X_stuck = np.eye(4)
        self._loose = -math.inf  # [s] since when the tool slides; -inf: it does not

    def displacement(self, X: Array) -> float:
        """How far a motion (4, 4) carries the patch sideways [m]: along x and z, and about y."""
        twist = _TWIST * self._reach * float(so3_log(X[:3, :3])[1])
        return math.hypot(float(X[0, 3]), float(X[2, 3]), twist)

    def step(self, X_CT: Array, t: float) -> Held:
        """With the tool moved to X_CT (4, 4) at time t [s]; steps of some milliseconds."""
        X = X_CT @ inverse_pose(self._X_CT) @ self._X_stuck
        self._X_CT = X_CT
        carried, bears = self.displacement(X), self._bears(t)
        if carried > bears:
            X = followed(X, 1.0 - bears / carried)
            self._loose = t if self._loose == -math.inf else self._loose
        else:
            self._loose = -math.inf
        self._X_stuck = X
        sliding = self._loose > -math.inf
        return Held(inverse_pose(X) @ X_CT, 1.0 if sliding else carried / self.hold, sliding)

    def _bears(self, t: float) -> float:
        """The displacement that friction bears [m]."""
        if self._loose == -math.inf:
            return self.hold
        return self.hold * (self._kinetic + (1.0 - self._kinetic) * math.exp(-(t - self._loose) / _SPRING_BACK))
