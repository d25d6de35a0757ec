# SPDX-License-Identifier: Apache-2.0
"""Gross slip: the tool breaks loose and slides in the grasp, and the alarm that is raised then.

Markers show where the membrane is, depth shows where the tool is. While the tool sticks, both move as one. When it
breaks loose, sliding friction bears less than what it stuck with, or not more. Hence seven signs:

    sprung back   the displacement of one finger's markers since the grasp falls at once, by more than their speed so
                  far explains; the patch still slips along its edge (incipient slip), and the other finger's has;
                  and where depth sees that direction well, depth does not fall
    gone on       depth goes on where markers do not, by more than micro-slip and noise explain
    left behind   material stays where it is from image to image while depth goes on (`following.py`); asked for longest
    parted        the fingers' markers go apart, which a tool that sticks to either does not let them (`parting.py`)
    stretched     material that was dragged stops, and its patch is stretched as one that slides (`stretching.py`)
    turned on     depth sees the tool turn on, though badly, while markers rest (`turning.py`)
    torn          the track is lost under a load, and no finger's markers are found as one body

A displacement has three components [m]: turn about y at the patch's reach, along x, along z. A fall is what the
markers' displacement loses within FALL_FRAMES; evidence counts falls in multiples of their threshold. A frame is locked
when the rigid fit explains it; a track without such frames is lost (`tracker.py`).

A tool that is set free lets the membrane spring back, too. But then the tool goes with it: as much of the image is
explained as usual. And the load is gone, while a tool that slides is borne by friction still. So where markers have
sprung back, the end of their fall is awaited: an alarm is raised where they stay above half of what they were, unless
depth has surely seen the tool go back with them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.sampling import Crop
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import motion_vector
from seed_estimation.slip.following import Following
from seed_estimation.slip.markers import FREE, FREE_ALL, SIDEWAYS, THREE, UNSEEN, Depth, Markers, Observation, sees
from seed_estimation.slip.parting import ACROSS, Parting
from seed_estimation.slip.stretching import AXES, Stretching
from seed_estimation.slip.turning import Turning

FALL_FRAMES = 2  # within which a membrane has sprung back
LOADED = 0.0015  # [m] below this displacement friction bears next to nothing
FALL, FALL_SHARE = 2e-4, 0.03  # [m], [1] threshold of a fall: so much, and this share of the displacement
FALL_SURE = 6.0  # deviations of noise
SLIPPING, SLIPPING_SHARE = 0.02, 0.5  # [1] incipient slip of a patch that slides, and of what it was before
LOSS = 0.03  # [1] of the image that the tool's pose must explain less than usual within a fall
SET_FREE = 0.5  # [1] of its displacement to which a membrane without load has sprung back, and one that slides has not
ALONG, ALONG_SURE = 0.3, 3.0  # [1] of the markers' way back, deviations from which on the tool surely goes with them
SETTLED, LONGEST = 0.015, 0.25  # [s] for which the end of a fall is awaited, at least and at most: a release lasts
FALLING = 0.6  # [1] of its steepest drop from which a fall goes on: a release grows faster, a slip slows at once
ASIDE = 1.0  # [1] of the fall along their displacement, by which markers that spring back may leave it at most
LEAST, MOST = 0.7, 1.5  # [thresholds] of fall from which a frame is evidence, and as how much it counts at most
MOSTLY = 0.95  # [1] of a direction that depth must see
FINE = 0.6  # [1] of a fall that counts, up to which depth's deviation tells whether the tool fell with the markers
APART, APART_SURE, APART_SHARE = 2.5e-4, 5.0, 0.3  # [m], deviations, share of the markers' travel: all three together
EVIDENCE = 1.25  # [thresholds] of fall of each finger's markers, over frames in a row, that raise the alarm
BROKEN = 0.035  # [s] after which markers that cannot be found as one body are taken for a slip


class GrossSlip:
    """The detector of one grasp: `slides` is called with every frame, locked or not."""

    def __init__(self, models: Sequence[FingerModel]) -> None:
        p = np.concatenate([m.p for m in models], axis=1)
        reach = float(np.sqrt(np.square(p[[0, 2]] - p[[0, 2]].mean(axis=1, keepdims=True)).sum(axis=0).mean()))
        self._lever = np.array((reach, 1.0, 1.0))
        # one bubble by itself mistakes yaw for x and roll for z, but not how far the markers of its patch have moved
        centre = np.array((0.0, p[1].mean() if len(models) == 1 else 0.0, 0.0))
        self._markers = {m.finger: Markers(m, self._lever, centre) for m in models}
        depths = [m.without_image() for m in models]
        self._following = Following(models, depths, self._lever) if len(models) > 1 else None
        self._parting, self._stretching = Parting(), Stretching(models)
        self._turning = Turning(models, depths, reach)
        self._evidence = 0.0  # [thresholds] of fall, summed over frames in a row
        self._fell = math.inf  # [s] when it was enough
        self._steepest = 0.0  # [m] drop of a frame since then

    @property
    def places(self) -> list[Array]:
        """X_CT (4, 4) where each finger's markers were last."""
        return [markers.X_CT for markers in self._markers.values()]

    def slides(self, crops: Mapping[str, Crop], fit: Fit, stamp: float, slip: float, locked: bool) -> bool:
        """Whether a frame at `stamp` [s] shows that the tool slides.

        crops: images by finger; fit: the best to them, locked or not; slip: micro-slip [1].
        """
        depth = UNSEEN
        if locked and len(self._markers) > 1:  # where depth would like to go, the other axes held: H^-1 g
            covariance = np.linalg.inv(fit.H_depth[THREE] + FREE)
            seen = motion_vector(fit.X_CT) - fit.ahead
            displacement = self._lever * (seen[SIDEWAYS] - covariance @ fit.g_depth[SIDEWAYS])
            depth = Depth(displacement, self._lever * np.sqrt(covariance.diagonal()))
        for markers in self._markers.values():
            markers.forget(stamp)
        held = [f for f in fit.fingers if np.isfinite(fit.depth_rms[f.model.finger])]
        judged = held or fit.fingers  # a membrane that the tool leaves springs back, and has not let it go
        least_loss = LOSS if len(self._markers) > 1 else -math.inf  # a bubble alone: the pose goes with its markers
        falls = []
        for finger in judged:
            markers = self._markers[finger.model.finger]
            near, known = (fit.X_CT, finger) if locked else (markers.X_CT, None)
            if markers.follow(crops[finger.model.finger], near, known, slip, stamp, depth):
                falls.append(sprung_back(markers.seen, markers.jitter, least_loss))
        if falls:  # markers that cannot be found say nothing either way
            self._evidence = self._evidence + sum(falls) if any(falls) else 0.0
        gone_on = len(self._markers) > 1 and all(depth_went_on(m.seen) for m in self._markers.values())
        fallen = self._fallen([self._markers[f.model.finger] for f in judged], stamp)
        left = self.leaves_behind(crops, fit, stamp, depth if locked else None)
        unseen = locked and self._slides_unseen(crops, fit, stamp, depth)
        return fallen or gone_on or left or unseen or (not locked and self._torn(stamp))

    def _slides_unseen(self, crops: Mapping[str, Crop], fit: Fit, stamp: float, depth: Depth) -> bool:
        """Whether both fingers' markers are seen in this frame, and tell of a slip that depth sees badly, if at all."""
        markers = list(self._markers.values())
        if len(markers) != 2 or not all(m.seen and m.seen[-1].stamp == stamp for m in markers):
            return False
        parted = self._parted(fit, markers)
        turns = self._turning.goes_on(crops, fit.X_CT, markers, depth)
        return self._stretching.slides(crops, fit.X_CT, markers, ~sees(depth.deviation)[AXES]) or parted or turns

    def _parted(self, fit: Fit, markers: Sequence[Markers]) -> bool:
        covariance = np.linalg.inv(fit.H_depth + FREE_ALL)
        turn = (motion_vector(fit.X_CT) - fit.ahead)[ACROSS]
        by_depth, deviation = turn - (covariance @ fit.g_depth)[ACROSS], np.sqrt(covariance.diagonal()[ACROSS])
        return self._parting.parts(markers, turn, by_depth, deviation)

    def leaves_behind(self, crops: Mapping[str, Crop], fit: Fit, stamp: float, depth: Depth | None = None) -> bool:
        """Whether the tool goes without the material: all that is told of a track that has been lost for a while.

        crops, fit, stamp: as of `slides`; depth: where it would put the tool; None: the track is lost.
        """
        if self._following is None or any(not np.isfinite(rms) for rms in fit.depth_rms.values()):
            return False
        return self._following.slides(crops, None if depth is None else fit.X_CT, depth or UNSEEN, stamp)

    def _fallen(self, judged: Sequence[Markers], stamp: float) -> bool:
        """Whether markers have sprung back, and to where friction bears them still; judged: by finger."""
        if self._evidence >= EVIDENCE * len(judged) and all(slipped_at_edge(m.seen) for m in judged):
            self._fell = min(self._fell, stamp)
        since = stamp - self._fell
        if since < 0.0:
            self._fell = math.inf  # the clock was set back, if it had fallen at all
            return False
        found = [m for m in judged if m.seen and m.seen[-1].stamp == stamp]
        now = [m.seen for m in found]
        if now and (
            all(without_load([size for _, size in m.sizes]) for m in found)
            or all(tool_went_along(seen) for seen in now)
        ):
            self._evidence, self._fell, self._steepest = 0.0, math.inf, 0.0
            return False
        drop = max((seen[-2].size - seen[-1].size for seen in now if len(seen) > 1), default=0.0)
        self._steepest = max(self._steepest, drop)
        falling = not now or drop > max(FALL, FALLING * self._steepest)
        return since > LONGEST or (since > SETTLED and not falling)

    def _torn(self, stamp: float) -> bool:
        """Whether the markers of a patch with incipient slip under its load have not been found for too long."""
        seen = [markers.seen for markers in self._markers.values() if markers.seen]
        slipping = any(s.size > LOADED and s.incipient > SLIPPING for finger in seen for s in finger)
        return slipping and stamp - max(finger[-1].stamp for finger in seen) > BROKEN


def sprung_back(seen: Sequence[Observation], jitter: float, least_loss: float = LOSS) -> float:
    """The markers' sudden fall, without the tool and while the patch still slips, over its threshold; 0: none.

    seen: observations of one finger, the last one now; jitter: noise of their displacement [m]; least_loss: of the
    share of the image that the tool's pose explains.
    """
    now = seen[-1]

    def foretold(back: int) -> Array:
        """The markers' displacement (3,) [m] now, had they kept the speed of so many frames ago."""
        before, top = seen[-3 - back], seen[-1 - back]
        speed = (top.displacement - before.displacement) / (top.stamp - before.stamp)
        return np.asarray(top.displacement + speed * (now.stamp - top.stamp))

    frames = range(1, min(FALL_FRAMES, len(seen) - 3) + 1)
    loaded = {back: seen[-1 - back] for back in frames if seen[-1 - back].size >= LOADED}
    falls = {back: min(top.size, math.hypot(*foretold(back))) - now.size for back, top in loaded.items()}
    if not falls:
        return 0.0
    back = max(falls, key=lambda b: falls[b])
    fall, before, expected = falls[back], loaded[back], foretold(back)
    share = fall / max(FALL, FALL_SHARE * before.size, FALL_SURE * jitter)
    slipping = now.doubtful or now.incipient > max(SLIPPING, SLIPPING_SHARE * before.incipient)
    lost = max(s.loss for s in list(seen)[-1 - FALL_FRAMES :])
    if share < LEAST or not slipping or lost < least_loss:
        return 0.0
    # A sheet that loses its load springs back against it; a sudden pull aside makes a displacement smaller, too.
    size = math.hypot(*expected)
    along = float(now.displacement @ expected) / size
    if math.sqrt(max(now.size**2 - along**2, 0.0)) > ASIDE * (size - along):
        return 0.0
    # Depth that sees the direction of the fall, by and large, tells whether the tool fell with the markers.
    change = now.displacement - before.displacement
    direction = change / max(math.hypot(*change), 1e-9)
    deviation = np.maximum(before.depth.deviation, now.depth.deviation)
    direction[~sees(deviation) | (deviation > FINE * max(fall, FALL))] = 0.0
    apart, apart_before = (s.depth.displacement - s.displacement for s in (now, before))
    stayed = -float(direction @ (apart - apart_before))
    fell_too = math.hypot(*direction) > MOSTLY and stayed < 0.3 * fall
    return 0.0 if fell_too else min(share, MOST)


def slipped_at_edge(seen: Iterable[Observation]) -> bool:
    """Whether incipient slip of one finger was seen: a tool slides in all fingers, and one not seen says nothing."""
    return not seen or any(s.doubtful or s.incipient > SLIPPING for s in seen)


def without_load(sizes: Sequence[float]) -> bool:
    """Whether one finger's markers have gone back further than friction lets them while the tool is under a load."""
    return sizes[-1] < SET_FREE * max(sizes)


def tool_went_along(seen: Sequence[Observation]) -> bool:
    """Whether depth has seen the tool go most of the way back that one finger's markers have gone since their furthest.

    The share is the best by all three directions, each as well as depth sees it.
    """
    now, top = seen[-1], max(seen, key=lambda s: s.size)
    if now.depth is UNSEEN or top.depth is UNSEEN:
        return False
    variance = np.square(now.depth.deviation) + np.square(top.depth.deviation)
    back, depth = now.displacement - top.displacement, now.depth.displacement - top.depth.displacement
    information = max(float(np.sum(back**2 / variance)), 1e-12)
    return float(np.sum(back * depth / variance)) / information - ALONG_SURE / math.sqrt(information) > ALONG


def depth_went_on(observations: Iterable[Observation]) -> bool:
    """Whether depth has gone on without the markers of one finger, along an axis that it sees."""
    seen = [s for s in observations if s.depth is not UNSEEN]  # while the track is lost depth says nothing
    before = len(seen) // 2
    if len(seen) < 5 or not sees(seen[0].depth.deviation).any():
        return False
    apart = np.array([s.depth.displacement for s in seen]) - np.array([s.displacement for s in seen])
    change = np.abs(apart[-2:].mean(axis=0) - apart[:before].mean(axis=0))
    if change.max() <= APART:
        return False
    travel = np.abs(np.diff([s.displacement for s in seen], axis=0)).sum(axis=0)
    deviation = np.median([s.depth.deviation for s in seen[:before]], axis=0)  # residuals grow when both part
    now = np.max([s.depth.deviation for s in seen[-2:]], axis=0)
    large = change > APART + APART_SURE * deviation + APART_SHARE * travel
    return bool((large & sees(deviation) & (now < 1.0)).any())
