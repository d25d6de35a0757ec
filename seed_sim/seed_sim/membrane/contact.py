# SPDX-License-Identifier: Apache-2.0
"""Contact of the sheet with the tool: normal penalty, and Coulomb friction with anchors that stick to the tool.

The sheet may touch at its nodes and in the middle of the sides between them, so that a patch does not grow by whole
nodes. Of a side the mean of its ends' profiles counts (`ToolSurface`): on a round tool it is as round as the tool.

Each touching place hangs on its anchor by a shear spring; where that would pull harder than friction bears, it slides
and the anchor follows (return mapping). All in T, so that anchors move with the tool.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_sim.membrane.mesh import Index
from seed_sim.membrane.surface import ToolSurface

Mask = NDArray[np.bool_]


class ContactLoad(NamedTuple):
    """What the tool does to the places that touch it.

    Attributes:
        places: (k,) indices. force: (k, 2, 3) [N] on their ends in T. push: (k,) [N] on both along the normal.
            stiffness: (k, 2, 2, 3, 3) [N/m], minus the force's slope, of each end by each, where that is asked for.
        sliding: (k,) bool. anchors: (k, 3) [m] to keep if this state is the equilibrium. energy: [J] of the normal
            springs. depth: [m] of the deepest place.
    """

    places: NDArray[Any]
    force: Array
    push: Array
    stiffness: Array | None
    sliding: Mask
    anchors: Array
    energy: float
    depth: float


class Contact:
    """Contact law of one bubble's sheet.

    Attributes:
        ends: (e, 2) nodes of each place that may touch: one twice, or both of a side.
        area: (e,) [m^2] of the sheet that belongs to it.
        anchors: (e, 3) [m] in T; NaN where a place does not touch.
        bound: (e,) [N] that friction bears, where that is held for now; None: friction times the present push.
    """

    def __init__(
        self, surface: ToolSurface, ends: Index, area: Array, friction: float, normal: float, shear: float
    ) -> None:
        """normal, shear: stiffnesses [N/m^3]."""
        self.surface, self.ends, self.area, self.friction = surface, ends, area, friction
        self._kn, self._kt = normal * area, shear * area
        self.anchors = np.full((len(area), 3), np.nan)
        self.bound: Array | None = None

    def load(self, x: Array, stiffness: bool = True) -> ContactLoad:
        """Forces, and stiffness if asked for, with nodes at x (n, 3) [m] in T."""
        surface, profile = self.surface, self.surface.profile(x)
        middle = 0.5 * (profile[self.ends[:, 0]] + profile[self.ends[:, 1]])
        near = np.flatnonzero(surface.may_hold(middle))
        places = near[surface.distance_of(middle[near]) < 0.0]
        ends = x[self.ends[places]]  # (k, 2, 3)
        gap, slope, H = surface.local_of(middle[places])
        kn, kt = self._kn[places], self._kt[places]
        push, to_ends = -kn * gap, surface.slope_by_ends(slope, ends)
        force = push[:, None, None] * to_ends
        point, n = 0.5 * ends.sum(axis=1), to_ends.sum(axis=1)
        size = np.sqrt(_dot(n, n))[:, None]
        n /= size
        old = ~np.isnan(self.anchors[places, 0])
        anchors = np.where(old[:, None], self.anchors[places], point)
        delta = point - anchors  # new places bear no shear in the step in which they touch
        out = _dot(n, delta)[:, None]
        g = delta - out * n
        length = np.sqrt(_dot(g, g))
        limit = self.friction * push if self.bound is None else self.bound[places]
        sliding = old & (kt * length > limit) & (self.friction > 0.0)
        safe = np.maximum(length, 1e-15)
        s = g / safe[:, None]
        pull = np.where(sliding, limit, kt * length) if self.friction > 0.0 else np.zeros(len(places))
        force = force - 0.5 * (pull[:, None] * s)[:, None]
        K = None
        if stiffness:
            bend = surface.bend_by_ends(slope, H, ends)
            K = to_ends[:, :, None, :, None] * to_ends[:, None, :, None, :] + gap[:, None, None, None, None] * bend
            K *= kn[:, None, None, None, None]
            if self.friction > 0.0:
                across = np.eye(3) - n[:, :, None] * n[:, None, :]
                turn = (across / size[:, None])[:, None] @ bend.sum(axis=1)  # (k, 2, 3, 3) slope of n by the ends
                shear = 0.5 * across[:, None] - out[:, None, None] * turn  # the same of g
                shear -= n[:, None, :, None] * (delta[:, None, None] @ turn)
                along = np.where(sliding, 1.0, 0.0)[:, None, None] * s[:, :, None] * s[:, None, :]
                shear -= along[:, None] @ shear
                scale = np.where(sliding, limit / safe, np.where(old, kt, 0.0))
                K += 0.5 * (scale[:, None, None, None] * shear)[:, None]
            if self.bound is None:  # what slides bears the more the harder it is pressed
                rise = 0.5 * self.friction * np.where(sliding, kn, 0.0)[:, None] * s
                K -= rise[:, None, None, :, None] * to_ends[:, None, :, None, :]
        slid = sliding | ~old
        reach = np.where(sliding, limit / kt, 0.0)
        anchors = np.where(slid[:, None], point - s * reach[:, None], anchors)
        energy, depth = 0.5 * float(kn @ gap**2), float(-gap.min()) if len(gap) else 0.0
        return ContactLoad(places, force, push, K, sliding, anchors, energy, depth)

    def bounds(self, load: ContactLoad) -> Array:
        """(e,) [N] that friction bears at a state."""
        push = np.zeros(len(self.area))
        push[load.places] = load.push
        return self.friction * push

    def keep(self, load: ContactLoad) -> None:
        """Remember the anchors of an equilibrium; places that do not touch forget theirs."""
        self.anchors = np.full_like(self.anchors, np.nan)
        self.anchors[load.places] = load.anchors


def _dot(a: Array, b: Array) -> Array:
    """(k,) of a, b (k, 3)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])
