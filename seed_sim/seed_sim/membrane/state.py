# SPDX-License-Identifier: Apache-2.0
"""What a solve of the membranes gives: shape, contact, pressure and load, for plant, images and scores alike."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, Wrench


class BubbleState(NamedTuple):
    """One bubble at one time.

    Attributes:
        nodes: (n, 3) [m] in C. triangles: (m, 3) their indices, constant.
        material: (n, 2) [m] x and z in C of each node on the flat, printed sheet, constant.
        touching: (n,) bool, nodes in contact with the tool. patch: (k, 3) [m] in C, all places of the sheet that are.
        touched, slid: [m^2] of the sheet that touches the tool, and of that which slides on it.
        pressure: [Pa] above the ambient. volume: [m^3] enclosed with its dead volume.
        wrench: load on the tool about T's origin, in T.
    """

    nodes: Array
    triangles: NDArray[Any]
    material: Array
    touching: NDArray[Any]
    patch: Array
    touched: float
    slid: float
    pressure: float
    volume: float
    wrench: Wrench


class GraspState(NamedTuple):
    """Both bubbles on the tool at one time.

    Attributes:
        X_CT: (4, 4) pose of the tool; identity at the grasp.
        bubbles: by finger, 'left' and 'right'.
        wrench: load of both on the tool about T's origin, in T.
        tangent: (6, 6) d(torque, force) in T over a small motion of C relative to T (rotation vector, then translation
            of C's origin, both written in T): positive for a spring that pulls the tool after the gripper.
        iterations: of the solver. converged: whether its residual met the bound.
    """

    X_CT: Array
    bubbles: dict[str, BubbleState]
    wrench: Wrench
    tangent: Array
    iterations: int
    converged: bool

    @property
    def sliding_share(self) -> float:
        """Share of the touching sheet that slides."""
        touched = sum(b.touched for b in self.bubbles.values())
        return sum(b.slid for b in self.bubbles.values()) / touched if touched > 0.0 else 0.0


def push_of(state: GraspState) -> float:
    """Of each finger on the tool along y of C [N], mean of both."""
    y = state.X_CT[1, :3]
    return float(np.mean([abs(float(y @ bubble.wrench.force)) for bubble in state.bubbles.values()]))
