# SPDX-License-Identifier: Apache-2.0
"""The tool followed from frame to frame by the rigid fit: prediction, locked or lost, relocalisation.

A frame is locked when the motion explains enough of one finger's image, and no finger that touches something
contradicts it by its depth, or by its image where depth tells nothing. A track that was lost is found when the motion
explains enough of the image of every finger that touches something. Where the first fit is not locked, others are tried
before the track is lost. A membrane that creeps along its edge or stretches does not move as one body: where one rigid
motion explains less, a frame is locked all the same if depth fits as well as usual and the material of every finger,
followed as it deforms, is found in its image: that of the patch, or that of the free band around it.
"""

from collections.abc import Collection, Mapping, Sequence
from functools import partial

import numpy as np

from seed_core.spatial import Array, inverse_pose, make_pose, rotation_error, so3_exp, so3_log
from seed_estimation.images.sampling import Crop, crop
from seed_estimation.images.tactile_images import TactileImages
from seed_estimation.material.motion import Followed, MaterialTracker, Motions
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.rigid_fit.covariance import HIDDEN
from seed_estimation.rigid_fit.fit import Fit, fit
from seed_estimation.rigid_fit.micro_slip import MicroSlip
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.relocalise import Relocaliser
from seed_estimation.rigid_fit.timing import Course, Timing
from seed_estimation.slip.gross import GrossSlip
from seed_estimation.slip.markers import SPAN

# Information that holds an axis which nothing sees where the prediction puts it: deviations of 0.5 rad and 20 mm
PRIOR = np.diag([1 / 0.5**2] * 3 + [1 / 0.02**2] * 3)
COARSE_STEPS = 6
SURE = 0.05  # a track that was lost must explain this much more of every image to count as found
SURE_FRAMES = 2  # and do so this many frames in a row
REACH = 0.35, 0.012  # [rad], [m] no tool jumps further than this between two frames
RANGE = 0.9, 0.03  # [rad], [m] nor is it found further than this from where it was grasped
APART = 3.0  # times the usual depth residual: the tool is not there
# [1] of every image that the rigid motion must explain, and the material as it deforms, where the former is too little
PART, WHOLE = 0.35, 0.6
CLEAR = 0.85  # [1] from which on the material of the patch moves as one with the tool
FITS = 1.6  # times the usual depth residual, up to which depth fits as well as usual
USUAL = 0.05  # weight of a frame in what is usual
PREDICTED = 0.1  # [s] longest time over which the velocity is taken to stay
STOPS = 0.5  # [s] after the last pose, for which the material of a lost track may still come to a stop
# [1] of the time between frames by which a finger may be ahead and still go by the speed of one frame: from a half on,
# an error of one frame puts a finger as far off to the other side in the next one, and grows. What is behind does so
# from a whole frame on only; an averaged speed would be that of a motion that has turned round meanwhile.
CALM = 0.4
FOLLOWED = 0.2  # [s] between frames, up to which they tell a velocity and a micro-slip


class Tracker:
    """Pose of the tool since the grasp.

    Attributes:
        models: of the fingers at the moment of grasp.
        X_CT: (4, 4) where the tool was last.
        lost: no pose is known; the tool is looked for.
        gross_slip: the tool has slid in the grasp; whatever the images say from then on is not about this grasp.
        ahead: (6,) by which the patches are ahead of the tool, as of `Fit`; whoever knows it sets it.
        closing: [m] by which each finger has come nearer to the tool since the grasp.
        slip: micro-slip. timing: skew of the fingers and lag of depth.
        patches, around: motion of the membranes' material in the last frame, of the patches and of the bands around
            them, by finger; only of those that are found. Of patches that one rigid motion explains, none is told.
    """

    def __init__(
        self, models: Sequence[FingerModel], images: Mapping[str, TactileImages], max_slip: float, timing: Timing
    ) -> None:
        """images: of the grasp itself, by finger: they tell how well depth fits when all is well; timing: at first."""
        self.models = tuple(models)
        self.X_CT = np.eye(4)
        self.lost = False
        self.gross_slip = False
        self.slip, self.timing = MicroSlip(max_slip), timing
        self.ahead, self.closing = np.zeros(6), 0.0
        self._course: Course | None = None
        self.patches: Motions = {}
        self.around: Motions = {}
        self._patches = Followed([MaterialTracker(m, m.patch) for m in models])
        self._bands = Followed([MaterialTracker(m, m.around) for m in models if m.around is not None])
        self._rate = np.zeros(6)  # [rotation vector, translation] per second, in C
        self._even_rate = np.zeros(6)  # averaged over some frames, the more the further a finger is ahead
        self._stamp = min(i.stamp for i in images.values())
        self._detector = GrossSlip(models)
        self._found = 0  # frames in a row since it was found again
        self._relocaliser: Relocaliser | None = None
        self._usual: dict[str, float] = {}  # [m] depth residual of each finger
        self._learn_usual(self._fit(self._crops(images, self.X_CT), self.X_CT, (0, 1)))

    def lose(self) -> None:
        """The track must be found again."""
        self.lost, self._found, self._relocaliser = True, 0, None

    def follow(
        self, images: Mapping[str, TactileImages], stamp: float, touching: Collection[str], p: EstimatorParameters
    ) -> Fit:
        """The best fit to images of time `stamp` [s]; `lost` and `gross_slip` say whether it may be believed.

        touching: fingers whose depth shows a contact, wherever it is; p: in force.
        """
        start, dt = self._predicted(stamp), stamp - self._stamp
        behind = self.timing.behind({f: i.stamp for f, i in images.items()}, stamp)
        on_course = not self.lost and 0.0 < dt <= FOLLOWED and any(behind.values())
        self._course = Course(self._even_rate, self._rate, behind) if on_course else None
        crops = self._crops(images, start)
        quality = partial(self._quality, touching)
        best = self._fit(crops, start, (COARSE_STEPS if self.lost else 0, p.iterations))
        share = quality(best)
        if share < p.lock:
            best = max([best, *self._fits_elsewhere(crops, start, p.iterations)], key=quality)
            share = quality(best)
        material: tuple[Motions, Motions] | None = None
        if share < p.lock and self._fits_in_part(touching, best, share):
            material = self._material_at(crops, best)
            if all(any(f in found and found[f].explained >= WHOLE for found in material) for f in touching):
                share = max(share, p.lock + 2.0 * SURE)
            else:
                material = None
        locked = share >= (p.lock + SURE if self.lost else p.lock)
        if locked or 0.0 < dt <= SPAN:
            self.gross_slip |= self._detector.slides(crops, best, stamp, self.slip.value, locked)
        elif 0.0 < dt <= STOPS:
            self.gross_slip |= self._detector.leaves_behind(crops, best, stamp)
        if share < p.lock and not self.lost:  # the markers may have sprung back, and the tool with them
            best = max([best, *(self._fit(crops, X, (0, p.iterations)) for X in self._detector.places)], key=quality)
            share = quality(best)
        if share >= p.lock and not self.lost and material is None:
            best = self._without_hidden_images(crops, best, touching, p.iterations)
            share = quality(best)
        self._accept(best, share, stamp, p)
        self.patches, self.around = {}, {}
        if not self.lost:
            clear = all(best.explained[f] > CLEAR for f in touching)
            self.patches, self.around = material or self._material_at(crops, best, not clear)
        return best

    def _material_at(self, crops: Mapping[str, Crop], found: Fit, patches: bool = True) -> tuple[Motions, Motions]:
        """How patches, if asked for, and bands have moved with the tool, by finger whose are found.

        Cameras that have come nearer see them so much further along y of C than they are.
        """
        seen = self._patches.follow(crops, found.X_CT) if patches else {}, self._bands.follow(crops, found.X_CT)
        back = {m.finger: make_pose(None, -found.closed * m.outward) for m in self.models}
        patch, band = ({f: m._replace(X_CM=back[f] @ m.X_CM) for f, m in motions.items()} for motions in seen)
        return patch, band

    def _fits_in_part(self, touching: Collection[str], found: Fit, share: float) -> bool:
        """Whether a fit that explains too little may be right: it explains a part, and depth fits as usual."""
        fits = all(found.depth_rms[f] <= FITS * self._usual.get(f, 0.0) for f in touching)
        return share > 0.0 and fits and all(found.explained[f] >= PART for f in touching)

    def _predicted(self, stamp: float) -> Array:
        """X_CT (4, 4) expected at a time [s], at constant velocity."""
        dt = min(max(stamp - self._stamp, 0.0), PREDICTED)
        if self.lost:
            return self.X_CT
        return make_pose(so3_exp(self._rate[:3] * dt) @ self.X_CT[:3, :3], self.X_CT[:3, 3] + self._rate[3:] * dt)

    def _crops(self, images: Mapping[str, TactileImages], X_CT: Array) -> dict[str, Crop]:
        """The images around the tool at a pose; the whole images while it is lost."""
        if self.lost:
            return {m.finger: crop(images[m.finger]) for m in self.models}
        return {m.finger: crop(images[m.finger], m.pixels(X_CT, m.seen)) for m in self.models}

    def _fit(self, crops: Mapping[str, Crop], start: Array, steps: tuple[int, int]) -> Fit:
        return self._fit_of(self.models, crops, start, steps)

    def _fit_of(
        self, models: Sequence[FingerModel], crops: Mapping[str, Crop], start: Array, steps: tuple[int, int]
    ) -> Fit:
        at = self._course.at if self._course is not None else None
        return fit(models, crops, start, self.slip.value, PRIOR, steps, at, self.ahead, self.closing)

    def _fits_elsewhere(self, crops: Mapping[str, Crop], start: Array, iterations: int) -> list[Fit]:
        """The fit from the likeliest of other places, if there are any: found anew, or near where the tool was."""
        starts = [start, self.X_CT]
        if self.lost:
            self._relocaliser = self._relocaliser or Relocaliser(self.models)
            starts = self._relocaliser.starts(crops)
        looked = [self._fit(crops, X, (COARSE_STEPS, 1)) for X in starts]
        if not looked:
            return []
        likeliest = max(looked, key=lambda found: min(found.explained.values()))
        return [self._fit(crops, likeliest.X_CT, (0, iterations))]

    def _without_hidden_images(
        self, crops: Mapping[str, Crop], found: Fit, touching: Collection[str], iterations: int
    ) -> Fit:
        """The fit without images that show something else: that something pulls at it."""
        hidden = [f for f in touching if found.explained[f] < HIDDEN]
        if not hidden:
            return found
        models = [m.without_image() if m.finger in hidden else m for m in self.models]
        return self._fit_of(models, crops, found.X_CT, (0, iterations))

    def _quality(self, touching: Collection[str], found: Fit) -> float:
        """Share of the images explained by the motion; a motion that no tool makes explains nothing."""
        X = found.X_CT if self.lost else inverse_pose(self.X_CT) @ found.X_CT
        if not np.isfinite(X).all() or self._contradicted(touching, found):
            return 0.0
        angle, way = float(np.linalg.norm(so3_log(X[:3, :3]))), float(np.linalg.norm(X[:3, 3]))
        most = RANGE if self.lost else REACH
        if angle > most[0] or way > most[1]:
            return 0.0
        shares = [found.explained[f] for f in touching]
        return max(found.explained.values()) if not self.lost else min(shares)

    def _contradicted(self, touching: Collection[str], found: Fit) -> bool:
        """Whether a finger that touches something does not see the tool there, by its image or by its depth."""
        told = [f for f in touching if np.isfinite(found.depth_rms[f])]
        off = any(found.depth_rms[f] > APART * self._usual.get(f, np.inf) for f in told)
        return not told or off or any(found.explained[f] < HIDDEN for f in touching if f not in told)

    def _accept(self, found: Fit, share: float, stamp: float, p: EstimatorParameters) -> None:
        """Takes a fit as the tool's pose, if the share of the images that it explains is large enough."""
        dt = stamp - self._stamp
        if self.lost:
            self._found = self._found + 1 if share > p.lock + SURE else 0
            if self._found < SURE_FRAMES:
                if self._found:
                    self.X_CT, self._stamp = found.X_CT, stamp
                return
        elif share < p.lock:
            self.lose()
            return
        followed = not self.lost and 0.0 < dt <= FOLLOWED
        turn, way = rotation_error(found.X_CT[:3, :3], self.X_CT[:3, :3]), found.X_CT[:3, 3] - self.X_CT[:3, 3]
        self._rate = np.concatenate([turn, way]) / dt if followed else np.zeros(6)
        ahead = -min(self._course.behind.values(), default=0.0) if self._course is not None else 0.0
        weight = CALM * dt / ahead if followed and ahead > CALM * dt else 1.0
        self._even_rate = self._even_rate + weight * (self._rate - self._even_rate)
        if followed:
            self.timing.learn(found, self.X_CT, dt, self._course)
        else:
            self.timing.resume(found, self.X_CT, dt)
        self.X_CT, self.closing, self._stamp, self.lost = found.X_CT, found.closing, stamp, False
        self._learn_usual(found)
        if p.learn_slip and followed:
            self.slip.update(found.slip_information, dt)

    def _learn_usual(self, found: Fit) -> None:
        for f, rms in found.depth_rms.items():
            if np.isfinite(rms):
                usual = self._usual.setdefault(f, rms)
                self._usual[f] = usual + USUAL * (min(rms, 2.0 * usual) - usual)
