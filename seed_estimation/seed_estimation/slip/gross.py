# SPDX-License-Identifier: Apache-2.0
"""The tool breaks loose: what cameras behind the membranes see of it, and an alarm made of that.

Dots show where the membrane is, depth shows where the tool is. While the tool sticks, both move as one. When it breaks
loose, sliding friction bears less than what it stuck with. Hence three signs:

    sprung back   the displacement of one finger's dots since the grasp falls at once, by more than its speed so far
                  explains, the patch stays torn, and where depth sees that direction well, depth does not fall (`dots`)
    apart         depth goes on where dots do not, by more than micro-slip and noise explain
    torn          the lock has broken under a load, and no finger's dots are found as one body
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.sampling import Frame
from seed_estimation.rigid_fit.fit import Fit, motion_vector
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.slip.markers import FREE, LOADED, PEELED, SEEN, SIDEWAYS, THREE, UNSEEN, Depth, Dots, Look, Seen

APART, APART_SURE, APART_SHARE = 2.5e-4, 5.0, 0.3  # [m], deviations, share of the way: all three together
EVIDENCE = 1.25  # [least falls] of each finger's dots, over frames in a row, that raise the alarm
BROKEN = 0.035  # [s] after which dots that cannot be found as one body are taken for a slip


class GrossSlip:
    """Watches one grasp: `slides` is asked with every frame, locked or not."""

    def __init__(self, models: Sequence[FingerModel]) -> None:
        p = np.concatenate([m.p for m in models], axis=1)
        reach = float(np.sqrt(np.square(p[[0, 2]] - p[[0, 2]].mean(axis=1, keepdims=True)).sum(axis=0).mean()))
        self._lever = np.array((reach, 1.0, 1.0))
        # one bubble by itself mistakes yaw for x and roll for z, but not how far the dots of its patch have moved
        self._centre = np.array((0.0, p[1].mean() if len(models) == 1 else 0.0, 0.0))
        self._dots = {m.finger: Dots(m, self._lever, self._centre) for m in models}
        self._evidence = 0.0  # [least falls]

    @property
    def places(self) -> list[Array]:
        """X_CT (4, 4) where each finger's dots were last."""
        return [dots.X_CT for dots in self._dots.values()]

    def slides(self, frames: Mapping[str, Frame], result: Fit, stamp: float, slip: float, locked: bool) -> bool:
        """Whether a frame shows that the tool slides."""
        depth = self._depth(result) if locked and len(self._dots) > 1 else UNSEEN
        for dots in self._dots.values():
            dots.forget(stamp)
        falls = []
        held = [s for s in result.sights if np.isfinite(result.depth_rms[s.model.finger])]
        for sight in held or result.sights:  # a membrane that the tool leaves springs back, and has not let it go
            dots, frame = self._dots[sight.model.finger], frames[sight.model.finger]
            near, known = (result.X_CT, sight) if locked else (dots.X_CT, None)
            falls.append(dots.fallen(Look(frame, near, known, slip, stamp, depth)))
        known_falls = [fall for fall in falls if fall is not None]
        if known_falls:  # dots that cannot be found say nothing either way
            self._evidence = self._evidence + sum(known_falls) if any(known_falls) else 0.0
        return self._evidence >= EVIDENCE * len(falls) or self._apart() or (not locked and self._broken(stamp))

    def _depth(self, result: Fit) -> Depth:
        """Where depth would like to go, the other axes held: H^-1 g."""
        covariance = np.linalg.inv(result.H_depth[THREE] + FREE)
        step = covariance @ result.g_depth[SIDEWAYS]
        way = self._lever * (motion_vector(result.X_CT)[SIDEWAYS] - step)
        return Depth(way, self._lever * np.sqrt(covariance.diagonal()))

    def _apart(self) -> bool:
        """Whether depth has gone on without the dots of both fingers, along an axis that it sees."""
        return len(self._dots) > 1 and all(_gone_on(_with_depth(dots.seen)) for dots in self._dots.values())

    def _broken(self, stamp: float) -> bool:
        """Whether the dots of a patch that had begun to peel under its load have not been found for too long."""
        seen = [dots.seen for dots in self._dots.values() if dots.seen]
        peeling = any(s.size > LOADED and s.peel > PEELED for finger in seen for s in finger)
        return peeling and stamp - max(finger[-1].stamp for finger in seen) > BROKEN


def _with_depth(seen: Iterable[Seen]) -> list[Seen]:
    """Frames in which the track was locked: in others depth's way is not known."""
    return [s for s in seen if s.depth is not UNSEEN]


def _gone_on(seen: list[Seen]) -> bool:
    before = len(seen) // 2
    if len(seen) < 5 or seen[0].depth.deviation.min() >= SEEN:
        return False
    apart = np.array([s.depth.way for s in seen]) - np.array([s.way for s in seen])
    change = np.abs(apart[-2:].mean(axis=0) - apart[:before].mean(axis=0))
    if change.max() <= APART:
        return False
    way = np.abs(np.diff([s.way for s in seen], axis=0)).sum(axis=0)
    deviation = np.median([s.depth.deviation for s in seen[:before]], axis=0)  # residuals grow when both part
    now = np.max([s.depth.deviation for s in seen[-2:]], axis=0)
    large = change > APART + APART_SURE * deviation + APART_SHARE * way
    return bool((large & (deviation < SEEN) & (now < 1.0)).any())
