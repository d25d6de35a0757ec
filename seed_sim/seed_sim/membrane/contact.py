# SPDX-License-Identifier: Apache-2.0
"""Contact of nodes with the tool: normal penalty, and Coulomb friction with anchors that stick to the tool.

Each touching node hangs on its anchor by a shear spring; where that would pull harder than friction bears, the node
slides and the anchor follows (return mapping). All in T, so that anchors move with the tool.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array
from seed_sim.membrane.surface import ToolSurface

Mask = NDArray[np.bool_]


class ContactLoad(NamedTuple):
    """What the tool does to the nodes that touch it.

    Attributes:
        nodes: (k,) indices. force: (k, 3) [N] on them in T. push: (k,) [N] its part along the
            normal. stiffness: (k, 3, 3) [N/m], minus the force's slope.
        sliding: (k,) bool. anchors: (k, 3) [m] to keep if this state is the equilibrium. energy: [J] of the normal
            springs. depth: [m] of the deepest node.
    """

    nodes: NDArray[Any]
    force: Array
    push: Array
    stiffness: Array
    sliding: Mask
    anchors: Array
    energy: float
    depth: float


class Contact:
    """Contact law of one bubble's nodes.

    Attributes:
        anchors: (n, 3) [m] in T; NaN where a node does not touch.
        bound: (n,) [N] that friction bears, where that is held for now; None: friction times the present push.
    """

    def __init__(self, surface: ToolSurface, area: Array, friction: float, normal: float, shear: float) -> None:
        """area (n,) [m^2] of the nodes, 0 where they cannot touch; stiffnesses [N/m^3]."""
        self.surface, self.area, self.friction = surface, area, friction
        self._kn, self._kt = normal * area, shear * area
        self.anchors = np.full((len(area), 3), np.nan)
        self.bound: Array | None = None

    def load(self, x: Array) -> ContactLoad:
        """Forces at nodes x (n, 3) [m] in T."""
        near = np.flatnonzero((np.abs(x) < self.surface.half).all(axis=1) & (self.area > 0.0))
        nodes = near[self.surface.distance(x[near]) < 0.0]
        point = x[nodes]
        phi, n, H = self.surface.local(point)
        kn, kt = self._kn[nodes], self._kt[nodes]
        push = -kn * phi
        force = push[:, None] * n
        K = kn[:, None, None] * (n[:, :, None] * n[:, None, :] + phi[:, None, None] * H)
        anchors = self.anchors[nodes]
        old = ~np.isnan(anchors[:, 0])
        anchors = np.where(old[:, None], anchors, point)
        delta = point - anchors
        normal_part = np.einsum("ni,ni->n", n, delta)
        g = delta - normal_part[:, None] * n
        length = np.linalg.norm(g, axis=1)
        limit = self.friction * push if self.bound is None else self.bound[nodes]
        sliding = old & (kt * length > limit)
        if self.friction > 0.0:
            # slope of the shear displacement; new nodes bear no shear in the step in which they touch
            slope = np.eye(3) - n[:, :, None] * n[:, None, :]
            slope = (
                slope - normal_part[:, None, None] * H - n[:, :, None] * np.einsum("nij,nj->ni", H, delta)[:, None, :]
            )
            safe = np.maximum(length, 1e-15)
            s = g / safe[:, None]
            scale = np.where(sliding, limit / safe, np.where(old, kt, 0.0))
            force = force - scale[:, None] * g
            turn = np.where(
                sliding[:, None, None], slope - s[:, :, None] * np.einsum("ni,nij->nj", s, slope)[:, None, :], slope
            )
            K = K + scale[:, None, None] * turn
            rise = self.friction * kn if self.bound is None else 0.0
            K = K - np.where(sliding, rise, 0.0)[:, None, None] * s[:, :, None] * n[:, None, :]
            reach = np.where(sliding, limit / kt, length)
            anchors = np.where(old[:, None], np.where(sliding[:, None], point - s * reach[:, None], anchors), point)
        energy = 0.5 * float(kn @ phi**2)
        depth = float(-phi.min()) if len(nodes) else 0.0
        return ContactLoad(nodes, force, push, K, sliding & (self.friction > 0.0), anchors, energy, depth)

    def bounds(self, load: ContactLoad) -> Array:
        """(n,) [N] that friction bears at a state."""
        push = np.zeros(len(self.area))
        push[load.nodes] = load.push
        return self.friction * push

    def keep(self, load: ContactLoad) -> None:
        """Remember the anchors of an equilibrium; nodes that do not touch forget theirs."""
        self.anchors = np.full_like(self.anchors, np.nan)
        self.anchors[load.nodes] = load.anchors
