# SPDX-License-Identifier: Apache-2.0
"""A recording of a hand that was turned with a known tool in it: the attitudes in which it rested, and what it bore.

Any recording will do in which the arm rests now and then with the tool free: nothing but its weight may load it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand, Tool, weight_about_T
from seed_core.spatial import Array, inverse_pose, wrench_adjoint
from seed_sysid.data.dataset import DatasetError
from seed_sysid.data.membrane_sample import MembraneSample, mean_membrane, mean_pose

SETTLE, LEAST = 1.0, 0.5  # [s] of a rest until the membranes have settled; that is averaged at least
_STILL, _STILL_COSINE = 5e-4, float(np.cos(np.deg2rad(0.3)))  # [m], and of the turn, of a flange that rests
_IMAGES = 5  # that a rest needs


class Attitude(NamedTuple):
    """A rest of the hand.

    Attributes:
        stamp: [s] of its first image that counts. images: how many do.
        X_CT: (4, 4) mean pose of the tool. X_CP: that of the membranes' patches, which is what loads a bushing.
        wrench: (6,) [N m, N] of the spring on the tool about T, in T: it carries the weight.
        membrane: what both membranes do; empty where that is not told.
    """

    stamp: float
    images: int
    X_CT: Array
    X_CP: Array
    wrench: Array
    membrane: tuple[MembraneSample, ...]

    @property
    def wrench_of_patches(self) -> Array:
        """(6,) [N m, N] of the spring about the patches' frame P, in P."""
        return np.asarray(wrench_adjoint(inverse_pose(self.X_CP) @ self.X_CT) @ self.wrench)


def attitudes(
    arm: Sequence[tuple[float, Array]], estimates: Sequence[RelativePoseEstimate], hand: Hand, tool: Tool
) -> list[Attitude]:
    """The attitudes of a recording in which the arm rested while the images told the pose of the tool.

    Args:
        arm: stamp [s] and X_WE (4, 4) of the flange, in the order of time.
        estimates: in the order of time.
        hand: where C is in the flange, and which way is up. tool: what is held; its weight is the load.

    Raises:
        DatasetError: the tool weighs nothing, or it slid in the grasp.
    """
    if tool.mass <= 0.0:
        raise DatasetError(f"tool.mass = {tool.mass:g} kg: without a weight there is nothing to measure by")
    out = []
    for begin, end, X_WE in _rests(arm):
        seen = [e for e in estimates if begin + SETTLE <= e.stamp <= end]
        slid = next((e.stamp for e in seen if e.gross_slip), None)
        if slid is not None:
            raise DatasetError(
                f"the tool had slid in the grasp {slid - arm[0][0]:.1f} s after the first pose of the arm: grasp it "
                "anew, more firmly, and turn the hand more slowly"
            )
        valid = [e for e in seen if e.valid]
        if len(valid) >= _IMAGES:
            out.append(_attitude(valid, X_WE[:3, :3] @ hand.X_EC[:3, :3], hand, tool))
    return out


def _attitude(seen: list[RelativePoseEstimate], R_WC: Array, hand: Hand, tool: Tool) -> Attitude:
    X_CT = mean_pose([e.X_CT for e in seen])
    weight = weight_about_T(tool.mass, tool.center_of_mass, R_WC @ X_CT[:3, :3], hand.up)
    return Attitude(
        stamp=seen[0].stamp,
        images=len(seen),
        X_CT=X_CT,
        X_CP=mean_pose([e.of_patches().X_CT for e in seen]),
        wrench=-weight.vector(),
        membrane=mean_membrane([e.membrane for e in seen]),
    )


def _rests(arm: Sequence[tuple[float, Array]]) -> list[tuple[float, float, Array]]:
    """Begin [s], end [s] and X_WE (4, 4) of every rest that is long enough."""
    out, begin = list[tuple[float, float, Array]](), 0
    for i in range(1, len(arm) + 1):
        if i < len(arm) and _still(arm[begin][1], arm[i][1]):
            continue
        if arm[i - 1][0] - arm[begin][0] >= SETTLE + LEAST:
            out.append((arm[begin][0], arm[i - 1][0], arm[begin][1]))
        begin = i
    return out


def _still(X: Array, Y: Array) -> bool:
    shift = Y[:3, 3] - X[:3, 3]
    cosine = 0.5 * (float(np.sum(X[:3, :3] * Y[:3, :3])) - 1.0)
    return float(shift @ shift) < _STILL**2 and cosine > _STILL_COSINE
