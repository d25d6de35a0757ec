# SPDX-License-Identifier: Apache-2.0
"""Material that was dragged along an axis that depth does not see, and stops: does the tool slide, or has it stopped?

A long cylinder that slides along its own axis looks like one that stands still. But a tool is rigid: what sticks to it
moves as fast as it does. So as long as one finger's material is still dragged, the other's that is much slower slides
on the tool. And where a patch lets go, it slides from its edge inwards: some of its points are slower than the fastest
ones before. A tool that stops takes both fingers' material to rest at once, and tells nothing, however much of its
patches slides: so does every press that comes to its end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array

FAST, LOADED = 0.02, 0.0015  # [m/s] of dragged material; [m] since the grasp, from which friction bears a load
LOOKED = 6  # steps that are looked back
STOPPED, BACK = 0.25, -0.1  # [1] of its largest speed, below which a finger's material has stopped, and still stays
PARTED, PARTED_SPEED = 0.1, 0.007  # [1] of the largest, [m/s] by which the fingers' speeds differ; the turn is noisy
MOVING = 0.6  # [1] of its largest speed, from which on the spread of a patch is looked at
SLOWER, NOISE, FASTEST = 0.93, 0.001, 95  # [1] of the fastest points' speed, [m/s], and [%] the percentile that is
HALTED, FALLEN = 0.1, 0.7  # [1] of its largest speed, on average and of the slower finger, between which that counts
PARTLY = 0.3  # [1] of the points are slower in a patch that slips


class Drag(NamedTuple):
    """How the material has moved from one image to the next along an axis.

    Attributes:
        speeds: of some points of each finger, without the turn of the tool [m/s].
        displacement: of the tool since the grasp, as the images have it [m].
    """

    speeds: Sequence[Array]
    displacement: float


def stops_as_it_slips(steps: Sequence[Drag]) -> bool:
    """Whether the material of both fingers, dragged until lately, has stopped as it does on a tool that slides."""
    looked = list(steps)[-LOOKED:]
    speed = np.array([[np.median(s) for s in step.speeds] for step in looked])  # (steps, fingers)
    way = np.sign(speed.sum())
    speed *= way
    largest = speed.max(axis=0)
    if largest.min() < FAST or max(way * step.displacement for step in looked) < LOADED:
        return False
    share = speed / largest
    if share[-1].max() > STOPPED or share[-1].min() < BACK or share[-2].max() <= STOPPED:
        return False
    fall = share[int(speed.mean(axis=1).argmax()) :]
    last = [int(np.flatnonzero(s > MOVING)[-1]) for s in share.T]
    slower = float(np.mean([_slower(way * looked[i].speeds[f]) for f, i in enumerate(last)]))
    apart = (np.ptp(fall, axis=1) > PARTED) & (np.ptp(fall * largest, axis=1) > PARTED_SPEED)
    apart &= (fall.mean(axis=1) > HALTED) & (fall.min(axis=1) < FALLEN)
    return bool(slower > PARTLY and apart.any())


def _slower(speeds: Array) -> float:
    """Share of the points that are slower than the fastest ones: those slide already."""
    return float(np.mean(speeds < SLOWER * np.percentile(speeds, FASTEST) - NOISE))
