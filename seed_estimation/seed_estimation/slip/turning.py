# SPDX-License-Identifier: Apache-2.0
"""A tool that turns on between fingers whose markers rest, where depth sees its turn badly.

A box's flat sides look nearly alike however far it has turned about y, the axis through both fingers. Depth alone knows
that turn to 3 degrees in one image, which is too little for the other signs. But what it sees goes on while the tool
does, and noise does not: the mean of a few frames, against the mean of those before, tells a turn of 3 to 6 degrees.
A face that is wider than the patch shows nothing of its turn: only where the fingers turn apart a slip is told then.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.sampling import Crop
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import motion_vector
from seed_estimation.slip.following import PAUSE, by_depth
from seed_estimation.slip.markers import Depth, Markers, sees
from seed_estimation.slip.stretching import EDGE

NOW, RESTING, BEFORE, FEWEST = 3, 4, 15, 6  # frames: means of now and of before, with markers that rest between them
LATELY = 0.6  # [s] that is looked back
GROWTH, SURE = 5e-4, 5.0  # [m] at the patch's reach, and deviations, by which the tool must have turned on
NOISE = 0.4  # [1] least noise, of the deviation that depth states: on simulated boxes it is 0.34 to 0.46 of that
# Depth that is late closes a gap as the tool stops, and depth of a wrong scale leaves one: [s] times the speed before,
# and share of the way since then, that count as none
LATE, SCALE = 0.025, 0.25
RESTS = 0.4  # [1] of the growth, up to which the markers' way is none
LEAP = 1.2e-3  # [m] between two frames, by which markers go that were found a pitch further
OFF = 3e-4  # [m] from the markers, from which on depth is fitted: one step towards it falls short
TURN, ABOUT_Y = 0, 1  # the turn about y in a displacement, and in a motion


class Turn(NamedTuple):
    """Of tool and markers in one frame.

    Attributes:
        stamp: [s].
        gap: by how much further the tool has turned, as depth sees it, than the markers have [m].
        deviation: of that, as depth states it [m].
        markers: (3,) displacement since the grasp, mean of both fingers [m].
    """

    stamp: float
    gap: float
    deviation: float
    markers: Array


class Turning:
    """Of the tool in one grasp."""

    def __init__(self, depths: Sequence[FingerModel], reach: float) -> None:
        """depths: models without image; reach: of the patch [m], at which a turn is a displacement."""
        self._depths, self._reach = depths, reach
        self._turns: deque[Turn] = deque(maxlen=RESTING + BEFORE)

    def goes_on(self, crops: Mapping[str, Crop], X_CT: Array, markers: Sequence[Markers], depth: Depth) -> bool:
        """Whether the tool turns, and the markers that both fingers show in these images rest.

        X_CT (4, 4): of the tool; depth: where it alone would put the tool.
        """
        now = [m.seen[-1] for m in markers]
        stamp, displacement = now[0].stamp, np.mean([s.displacement for s in now], axis=0)
        step = float(np.abs(displacement - self._turns[-1].markers).max()) if self._turns else 0.0
        if self._turns and (not 0.0 < stamp - self._turns[-1].stamp <= PAUSE or step > LEAP):
            self._turns.clear()
        while self._turns and stamp - self._turns[0].stamp > LATELY:
            self._turns.popleft()
        edge = float(np.mean([s.incipient for s in now]))
        turned, rested = float(depth.displacement[TURN]), float(displacement[TURN])
        if step < RESTS * GROWTH and edge > EDGE and abs(turned - rested) > OFF:
            found = by_depth(self._depths, crops, X_CT)
            turned = turned if found is None else self._reach * float(motion_vector(found.X_CT)[ABOUT_Y])
        self._turns.append(Turn(stamp, turned - rested, float(depth.deviation[TURN]), displacement))
        # friction that gives way has held the tool back until then; what depth sees well has other signs
        return edge > EDGE and not sees(depth.deviation)[TURN] and grown(self._turns) * rested > 0.0


def grown(turns: Sequence[Turn]) -> float:
    """By how much the gap has surely grown of late while the markers rest [m], with its sign; 0: it has not."""
    gaps, markers = np.array([t.gap for t in turns]), np.array([t.markers for t in turns])
    before, now = gaps[:-RESTING], gaps[-NOW:]
    if len(before) < FEWEST:
        return 0.0
    growth = float(now.mean() - before.mean())
    way = float(np.abs(np.diff(markers[-RESTING:], axis=0)).sum(axis=0).max())
    if abs(growth) < GROWTH or way > RESTS * abs(growth):
        return 0.0
    noise = max(float(np.diff(before).std()) / math.sqrt(2.0), NOISE * float(np.mean([t.deviation for t in turns])))
    stamps = np.array([t.stamp for t in turns])
    turn = markers[:, TURN]
    speed = float(np.abs(np.diff(turn) / np.diff(stamps)).max())
    usual = LATE * speed + SCALE * abs(float(turn[-1] - turn[:-RESTING].mean()))
    return growth if abs(growth) > usual + SURE * noise * math.sqrt(1.0 / len(now) + 1.0 / len(before)) else 0.0
