# SPDX-License-Identifier: Apache-2.0
"""From pairs of tactile images to the pose of the tool in the grasp: the core behind the estimator node.

    estimator = Estimator(parameters, hand, {"left": camera, "right": camera})
    estimator.capture_reference(frames)     # bubbles touch nothing
    estimator.initialize_grasp(frames)      # tool grasped: T := C
    estimate = estimator.update(images, stamp)

Bad images never raise in `update`: the estimate is then not valid, and says why.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import Hand
from seed_estimation import report as reporting
from seed_estimation.calibration import file as calibration_file
from seed_estimation.contact.patch import QUICK, ContactPatch, Mask, PatchFinder, mean_depth
from seed_estimation.images import identity
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import EstimatorError, Intake
from seed_estimation.images.sampling import prepare
from seed_estimation.images.tactile_images import Image, TactileImages
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.published import FlowSettings, PublishedMethod
from seed_estimation.rigid_fit import reference as finger_model
from seed_estimation.tracker import Tracker

__all__ = ["Estimator", "EstimatorError", "EstimatorParameters"]

FINGERS = ("left", "right")
SLIPPED = "the tool has slipped in the grasp: initialize the grasp again"
Frames = Sequence[Mapping[str, TactileImages]]


class Estimator:
    """Pose of the grasped tool and contact patches from one or two bubbles.

    Attributes:
        patches: contact of each finger in the last images.
        masks: (H, W) contact masks of the last images, 0 or 1.
        parameters: in force.
    """

    def __init__(self, parameters: EstimatorParameters, hand: Hand, cameras: Mapping[str, PinholeCamera]) -> None:
        """cameras: calibrations of the full images by finger: 'left', 'right' or both.

        Raises:
            EstimatorError: no camera, or a finger of another name.
            ConfigError: the calibration file cannot be used.
        """
        unknown = [f for f in cameras if f not in FINGERS]
        if unknown or not cameras:
            raise EstimatorError(f"cameras of {sorted(cameras) or 'no finger'}: give 'left', 'right' or both")
        known = calibration_file.load(parameters.calibration) if parameters.calibration else None
        self.parameters, self.hand = parameters, known.hand(hand) if known else hand
        self.fingers = tuple(f for f in FINGERS if f in cameras)
        self.full_cameras = dict(cameras)
        self.cameras = {f: cameras[f].decimated(parameters.decimate) for f in self.fingers}
        self.X_CX = {"left": self.hand.X_CL, "right": self.hand.X_CR}
        self._intake = Intake({f: cameras[f] for f in self.fingers}, parameters)
        self.patterns: dict[str, Image] = {}
        self.patches: dict[str, ContactPatch] = {}
        self.masks: dict[str, Mask] = {}
        self._finders: dict[str, PatchFinder] = {}
        self._images: Mapping[str, TactileImages] = {}
        self._forget_grasp()
        if known:
            self.use_calibration(known.range_offsets())

    def _forget_grasp(self) -> None:
        self._tracker: Tracker | None = None
        self._published: PublishedMethod | None = None
        self._stamp = -np.inf

    @property
    def has_reference(self) -> bool:
        return len(self._finders) == len(self.fingers)

    @property
    def identity(self) -> str:
        """'verified' when each finger's saved dot pattern is known, else 'unverified'."""
        return "verified" if all(f in self.patterns for f in self.fingers) else "unverified"

    def reconfigure(self, parameters: EstimatorParameters) -> None:
        """New parameters; reference and grasp are kept where they do not depend on what changed."""
        before, self.parameters, self._intake.parameters = self.parameters, parameters, parameters
        if before.decimate != parameters.decimate or before.method != parameters.method:
            self.cameras = {f: c.decimated(parameters.decimate) for f, c in self.full_cameras.items()}
            self._forget_grasp()
        if before.decimate != parameters.decimate:
            self._finders = {}
            self._intake.correct(self._intake.range_offset, {})
        for finder in self._finders.values():
            finder.parameters = parameters
        if self._tracker is not None:
            self._tracker.parameters = parameters

    def use_calibration(self, range_offset: Mapping[str, Image]) -> None:
        """Range offset maps (H, W) [m], true minus measured, of the full images; 0 where not known.

        Raises:
            EstimatorError: a map's shape is not its image's.
        """
        self._intake.correct(range_offset, {})
        self._finders = {}
        self._forget_grasp()

    # -- bubbles touch nothing, tool grasped ---------------------------------------------------------------------

    def capture_reference(self, frames: Frames) -> None:
        """Takes the images of bubbles that touch nothing as reference; several frames are averaged.

        Raises:
            EstimatorError: no usable images of a finger, or images of another finger or upside down.
            NoReferenceError: too little membrane in view.
        """
        intake = Intake(self._intake.cameras, self.parameters)
        intake.correct(self._intake.range_offset, {})
        series = intake.usable(frames, "reference")
        for finger in self.fingers:
            mistake = identity.mistaken(finger, series[finger][-1].ir, self.patterns)
            if mistake:
                raise EstimatorError(mistake)
        p = self.parameters
        self._finders = {
            f: PatchFinder(f, self.cameras[f], self.X_CX[f], [i.depth for i in series[f]], p) for f in self.fingers
        }
        self._intake.correct(intake.range_offset, {f: finder.correction for f, finder in self._finders.items()})
        for finger in self.fingers:
            self.patterns[finger] = identity.pattern(np.mean([i.ir for i in series[finger]], axis=0, dtype=np.float32))
        self._forget_grasp()

    def initialize_grasp(self, frames: Frames) -> None:
        """The tool is grasped: T := C from these images on; several frames, with nothing moving, are averaged.

        Raises:
            EstimatorError: no reference, no usable images, or a finger without contact.
        """
        if not self.has_reference:
            raise EstimatorError("no reference: capture one with the bubbles touching nothing before a grasp")
        series = self._intake.usable(frames, "grasp")
        self._forget_grasp()
        p, patches, masks, ir, depth = self.parameters, {}, {}, {}, {}
        for f in self.fingers:
            depth[f], _ = mean_depth([i.depth for i in series[f]], p.near, p.far)
            ir[f] = np.asarray(np.mean([i.ir for i in series[f]], axis=0), np.float32)
            masks[f], patches[f] = self._finders[f].find(depth[f])
            if not patches[f].in_contact:
                raise EstimatorError(
                    f"{f} bubble touches nothing: no {p.least_area} px are indented by {p.threshold * 1e3:g} mm; "
                    "close the gripper"
                )
        self.patches, self.masks = patches, masks
        if p.method == "published":
            if len(self.fingers) < 2:
                raise EstimatorError("the published method needs both bubbles; use method 'rigid_fit' with one")
            self._published = PublishedMethod(patches, ir, self.X_CX, p.curl_gain, FlowSettings(window=p.flow_window))
        else:
            self._tracker = self._new_tracker(depth, ir, masks, series)
        self._stamp = max(i[-1].stamp for i in series.values())

    def _new_tracker(
        self,
        depth: Mapping[str, Image],
        ir: Mapping[str, Image],
        masks: Mapping[str, Mask],
        series: Mapping[str, Sequence[TactileImages]],
    ) -> Tracker:
        p, models = self.parameters, []
        for f in self.fingers:
            core = self._finders[f].core(depth[f], masks[f])
            model = finger_model.build(
                f, self.cameras[f], self.X_CX[f], self._finders[f].rest, depth[f], ir[f], core, p
            )
            if model is None:
                raise EstimatorError(f"{f} bubble: the patch is too small to follow; close the gripper further")
            models.append(model)
        tracker = Tracker(models, p, max(i[-1].stamp for i in series.values()))
        boxes = tracker.boxes(np.eye(4))
        tracker.expect({f: prepare(series[f][-1].ir, series[f][-1].depth, boxes[f]) for f in self.fingers})
        return tracker

    # -- at the frame rate -----------------------------------------------------------------------------------------

    def update(self, images: Mapping[str, TactileImages], stamp: float) -> RelativePoseEstimate:
        """The tool's pose in C at `stamp` [s] from one set of images by finger; never raises on bad images."""
        problem = self._problem(images, stamp)
        if problem:
            self.patches, self.masks, self._images = {}, {}, {}  # what was seen before is not what is there now
            return self._invalid(stamp, problem)
        reduced = {f: self._intake.reduced(f, images[f]) for f in self.fingers}
        self._images = reduced
        step = QUICK if self._published is None else 1
        for finger in self.fingers:
            self.masks[finger], self.patches[finger] = self._finders[finger].find(reduced[finger].depth, step)
        gap = stamp - self._stamp
        self._stamp = stamp
        if self._published is not None:
            return self._update_published(reduced, stamp)
        if self._tracker is not None:
            return self._update_rigid_fit(self._tracker, reduced, stamp, gap)
        return self._invalid(stamp, "no grasp: initialize_grasp has not been called since the last reference")

    def _problem(self, images: Mapping[str, TactileImages], stamp: float) -> str:
        """Why images cannot be used, or ''."""
        if not np.isfinite(stamp):
            return f"stamp {stamp} is not a time"
        if stamp <= self._stamp:
            return (
                f"stamp {stamp:.6f} s is not later than the one before, {self._stamp:.6f} s: images came out of order"
            )
        problem = self._intake.problem(images)
        if not problem and not self.has_reference:
            return "no reference: capture_reference has not been called"
        return problem

    def _update_published(self, images: Mapping[str, TactileImages], stamp: float) -> RelativePoseEstimate:
        assert self._published is not None
        silent = [f for f in self.fingers if not self.patches[f].in_contact]
        if silent:
            return self._invalid(stamp, f"{' and '.join(silent)} bubble touches nothing")
        X_CT = self._published.pose(self.patches, {f: images[f].ir for f in self.fingers}, self.masks)
        if X_CT is None:
            return self._invalid(stamp, "the two patches define no frame: they stand above each other along z")
        return reporting.published(stamp, X_CT)

    def _update_rigid_fit(
        self, tracker: Tracker, images: Mapping[str, TactileImages], stamp: float, gap: float
    ) -> RelativePoseEstimate:
        p = self.parameters
        if tracker.gross_slip:  # whatever the dots say now, it is not about this grasp
            return self._invalid(stamp, SLIPPED)
        if gap > p.max_gap:
            tracker.lose()
        boxes = tracker.boxes(tracker.predicted(stamp))
        frames = {f: prepare(images[f].ir, images[f].depth, boxes[f]) for f in self.fingers}
        result = tracker.step(frames, stamp, [f for f, patch in self.patches.items() if patch.in_contact])
        if tracker.gross_slip:
            return self._invalid(stamp, SLIPPED)
        if tracker.lost:
            mistakes = (identity.mistaken(f, images[f].ir, self.patterns) for f in self.fingers)
            reason = next((m for m in mistakes if m), "")
            return self._invalid(stamp, reason or reporting.lost_reason(result, self.patches, p.lock))
        return reporting.rigid_fit(stamp, result, tracker, self.patches, p)

    def _invalid(self, stamp: float, reason: str) -> RelativePoseEstimate:
        slipped = self._tracker is not None and self._tracker.gross_slip
        return reporting.invalid(stamp, reason, self.parameters.method, gross_slip=slipped)

    def debug_image(self) -> np.ndarray:
        """(H, W, 3) uint8 BGR: infrared of each finger with contact outlined and motion drawn."""
        return reporting.debug_image(self.fingers, self._images, self.cameras, self.masks, self._tracker)
