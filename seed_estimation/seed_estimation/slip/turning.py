# SPDX-License-Identifier: Apache-2.0
"""A tool that turns on between fingers whose markers rest, where depth sees its turn badly.

A box's flat sides look nearly alike however far it has turned about y, the axis through both fingers. Depth alone knows
that turn to 3 degrees in one image, which is too little for the other signs. But what it sees goes on while the tool
does, and noise does not: the mean of a few frames, against the mean of those before, tells a turn of 3 to 6 degrees.
A face that is wider than the patch shows nothing of its turn: only where the fingers turn apart a slip is told then.

Where the markers' turn has just ended, and the patch's edge had nearly stopped while its middle turned still
(`twisting.py`), a slip is likely. So less of depth's turn is enough then, from two images on.
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
from seed_estimation.slip.stretching import BACK, EDGE, RESTS, STOPPED
from seed_estimation.slip.twisting import Twisting

NOW, RESTING, BEFORE, FEWEST = 3, 4, 15, 6  # frames: means of now and of before, with markers that rest between them
LATELY = 0.6  # [s] that is looked back
GROWTH, SURE = 5e-4, 5.0  # [m] at the patch's reach, and deviations, by which the tool must have turned on
NOISE = 0.4  # [1] least noise, of the deviation that depth states: on simulated boxes it is 0.34 to 0.46 of that
# Depth that is late closes a gap as the tool stops, and depth of a wrong scale leaves one: [s] times the speed before,
# and share of the way since then, that count as none
LATE, SCALE = 0.025, 0.25
STILL = 0.4  # [1] of the growth, up to which the markers' way is none
# A turn of the markers that has just ended: [m/s] of it at least, within so many [s]. [m] of its end by the patches'
# middle, over which their edge must have followed by no more than this share [1]: 0.35 to 0.61 in slips of simulated
# boxes, 0.5 to 0.7 in turns that were stopped while half of the patch slid, 0.3 to 0.6 where nearly all did. So depth
# has to say as much, but three deviations are enough beyond what a wrong scale of it may leave of the way: slips came
# to 3 to 20 in time, turns that were stopped to 2.2, more only where five sixths of the patch slid.
FAST, RECENT = 5e-3, 0.14
END, FOLLOWS = 1.7e-4, 0.65
LIKELY, SCALED = 3.0, 0.2
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
        twist: (2,) turn of the patches' middle and edge since the frame before [m]; None: not looked at, or not found.
    """

    stamp: float
    gap: float
    deviation: float
    markers: Array
    twist: Array | None = None


class Turning:
    """Of the tool in one grasp."""

    def __init__(self, models: Sequence[FingerModel], depths: Sequence[FingerModel], reach: float) -> None:
        """depths: models without image; reach: of the patch [m], at which a turn is a displacement."""
        self._depths, self._reach = depths, reach
        self._twisting = Twisting(models, reach)
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
        if step < STILL * GROWTH and edge > EDGE and abs(turned - rested) > OFF:
            found = by_depth(self._depths, crops, X_CT)
            turned = turned if found is None else self._reach * float(motion_vector(found.X_CT)[ABOUT_Y])
        last = self._turns[-1] if self._turns else None
        turns = last is not None and abs(rested - last.markers[TURN]) > STOPPED * FAST * (stamp - last.stamp)
        twist = self._twisting.step(crops, markers, turns)
        self._turns.append(Turn(stamp, turned - rested, float(depth.deviation[TURN]), displacement, twist))
        if edge < EDGE or sees(depth.deviation)[TURN]:  # what depth sees well has other signs
            return False
        # friction that gives way has held the tool back until then
        return grown(self._turns) * rested > 0.0 or slid_on(self._turns)


def grown(turns: Sequence[Turn]) -> float:
    """By how much the gap has surely grown of late while the markers rest [m], with its sign; 0: it has not."""
    gaps, markers = np.array([t.gap for t in turns]), np.array([t.markers for t in turns])
    before, now = gaps[:-RESTING], gaps[-NOW:]
    if len(before) < FEWEST:
        return 0.0
    growth = float(now.mean() - before.mean())
    way = float(np.abs(np.diff(markers[-RESTING:], axis=0)).sum(axis=0).max())
    if abs(growth) < GROWTH or way > STILL * abs(growth):
        return 0.0
    noise = _noise(turns, before)
    stamps = np.array([t.stamp for t in turns])
    turn = markers[:, TURN]
    speed = float(np.abs(np.diff(turn) / np.diff(stamps)).max())
    usual = LATE * speed + SCALE * abs(float(turn[-1] - turn[:-RESTING].mean()))
    return growth if abs(growth) > usual + SURE * noise * math.sqrt(1.0 / len(now) + 1.0 / len(before)) else 0.0


def slid_on(turns: Sequence[Turn]) -> bool:
    """Whether a turn of the markers has just ended as the patch let go, and the tool has likely turned on since."""
    if len(turns) < FEWEST + RESTS:
        return False
    stamps, way = np.array([t.stamp for t in turns]), np.array([t.markers[TURN] for t in turns])
    speed = np.diff(way) / np.diff(stamps)
    recent = speed[stamps[1:] > stamps[-1] - RECENT]
    side = math.copysign(1.0, recent[np.abs(recent).argmax()])
    largest = float(np.abs(recent).max())
    if largest < FAST or side * way[-1] < 0.0:  # friction holds back what it has turned
        return False
    moves = np.nonzero((side * speed > STOPPED * largest) | (side * speed < BACK * largest))[0]
    rests = len(speed) - 1 - int(moves[-1])  # frames
    unturned = int(np.argmax(np.abs(speed) > FAST)) + 1  # frames before it turned: late depth makes no gap there
    share = follows(turns, side)
    if rests < RESTS or unturned < FEWEST or share is None or share > FOLLOWS:
        return False
    gaps = side * np.array([t.gap for t in turns])
    before, now = gaps[:unturned], gaps[-min(rests, NOW) :]
    usual = SCALED * abs(float(way[-1] - way[:unturned].mean()))
    growth = float(now.mean() - before.mean())
    return growth > usual + LIKELY * _noise(turns, before) * math.sqrt(1.0 / len(now) + 1.0 / len(before))


def follows(turns: Sequence[Turn], side: float) -> float | None:
    """Share [1] by which the patches' edge followed their middle at the end of a turn to a side (-1, 1)."""
    total = np.zeros(2)
    for turn in reversed(turns):
        if turn.twist is not None:
            total += side * turn.twist
        if total[0] > END:
            return float(total[1] / total[0])
    return None


def _noise(turns: Sequence[Turn], before: Array) -> float:
    """Of one frame's gap [m], by those before and by what depth states."""
    stated = NOISE * float(np.mean([t.deviation for t in turns]))
    return max(float(np.diff(before).std()) / math.sqrt(2.0), stated)
