# SPDX-License-Identifier: Apache-2.0
"""From pairs of tactile images to the pose of the tool in the grasp: the core behind the estimator node.

    estimator = Estimator(parameters, hand, {"left": camera, "right": camera})
    estimator.capture_reference(frames)     # bubbles touch nothing
    estimator.initialize_grasp(frames)      # tool grasped: T := C
    estimate = estimator.update(images, stamp)

Images pass checks, contact patches, fit, covariance and report, in this order: see `update`. Bad images never raise
there: the estimate is then not valid, and says why.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seed_core.config import ConfigError, checked
from seed_core.estimate import NO_GRASP, REFUSED, RelativePoseEstimate
from seed_core.hand import FINGERS, Hand
from seed_estimation import report
from seed_estimation.calibration import file as calibration_file
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.contact.reference import NO_LOAD, Grasp, Reference
from seed_estimation.images import identity
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import SET_BACK, Alive, EstimatorError, Frame, frame_problem, usable_images
from seed_estimation.images.tactile_images import Image, Mask, TactileImages
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.published import PublishedMethod
from seed_estimation.rigid_fit.covariance import Covariance
from seed_estimation.rigid_fit.reference import finger_model
from seed_estimation.rigid_fit.systematic import Systematic
from seed_estimation.rigid_fit.timing import Timing
from seed_estimation.tracker import Tracker

# Methods of `parameters.METHODS` that answer from both contact patches; `rigid_fit` is the Tracker.
PATCH_METHODS: dict[str, type[PublishedMethod]] = {"published": PublishedMethod}


class Estimator:
    """Pose of the grasped tool and contact patches from one or two bubbles.

    Attributes:
        parameters: in force.
        hand: as calibrated.
        fingers: those that have a camera.
        patches: contact of each finger in the last images.
        masks: (H, W) contact masks of the last images, 0 or 1, by finger.
        zero: what the last grasp's patches say about its load.
        patterns: (H, W) dot pattern of each finger's membrane, as `identity.pattern` gives it.
    """

    def __init__(
        self,
        parameters: EstimatorParameters,
        hand: Hand,
        cameras: Mapping[str, PinholeCamera],
        calibration: calibration_file.Calibration | None = None,
        patterns: Mapping[str, Image] | None = None,
    ) -> None:
        """An estimator without reference and grasp.

        Args:
            parameters, hand: see there; the hand's cameras are as drawn, a calibration replaces their places.
            cameras: calibrations of the full images by finger: 'left', 'right' or both.
            calibration: of range and camera poses; without it, the file that the parameters name, if any.
            patterns: dot patterns that are known from before, by finger.

        Raises:
            EstimatorError: no camera, a finger of another name, or a calibration of images of another size.
            ConfigError: a parameter is out of its bounds, or the calibration file cannot be used.
        """
        parameters = checked(parameters, "EstimatorParameters")
        unknown = [f for f in cameras if f not in FINGERS]
        if unknown or not cameras:
            raise EstimatorError(f"cameras of {sorted(cameras) or 'no finger'}: give 'left', 'right' or both")
        if calibration is None:
            calibration = calibration_file.load(parameters.calibration)
        self.parameters, self.hand = parameters, calibration.hand(hand)
        self.fingers = tuple(f for f in FINGERS if f in cameras)
        self.patterns = dict(patterns or {})
        self.patches: dict[str, ContactPatch] = {}
        self.masks: dict[str, Mask] = {}
        self._full_cameras = {f: cameras[f] for f in self.fingers}
        self._X_CX = {"left": self.hand.X_CL, "right": self.hand.X_CR}
        self._range_offset = {f: calibration.range_offset(f, c.shape) for f, c in self._full_cameras.items()}
        self._reference: Reference | None = None
        self.zero = NO_LOAD
        self._images: dict[str, TactileImages] = {}  # the last, at the working resolution
        self._stamp = -np.inf  # [s] of the last images since the grasp: of the older finger's
        self._touched = -np.inf  # [s] of the last images in which a finger touched the tool
        self._no_grasp = NO_GRASP  # why there is none
        self._alive = Alive({})
        self._tracker: Tracker | None = None  # with a grasp and method rigid_fit
        self._mutual = calibration.mutual_deviation
        self._covariance = self._new_covariance()
        self._patch_method: PublishedMethod | None = None  # with a grasp and a method of PATCH_METHODS

    def reconfigure(self, parameters: EstimatorParameters) -> None:
        """New parameters; reference and grasp are kept where they do not depend on what changed.

        What a reference or a grasp was made with counts from the next one on; the parameters' help says which that is.

        Raises:
            ConfigError: a parameter is out of its bounds, or `calibration` is another: that needs a new estimator.
        """
        before, parameters = self.parameters, checked(parameters, "EstimatorParameters")
        if parameters.calibration != before.calibration:
            raise ConfigError(f"calibration = {parameters.calibration!r} cannot be changed while the estimator runs")
        self.parameters = parameters
        self._covariance.systematic = self._systematic()
        if self._tracker is not None:
            self._tracker.slip.most = parameters.max_slip
        if self._patch_method is not None:
            self._patch_method.parameters = parameters
        if before.decimate != parameters.decimate or before.method != parameters.method:
            self._forget_grasp(NO_GRASP)
        if before.decimate != parameters.decimate:
            self._reference = None

    # -- bubbles touch nothing, tool grasped ---------------------------------------------------------------------

    def capture_reference(self, frames: Sequence[Frame]) -> None:
        """Takes the images of bubbles that touch nothing as reference; two frames or more are averaged.

        Raises:
            EstimatorError: less than two usable images of a finger, images of another or upside down, too little
                membrane in view.
        """
        p, n = self.parameters, self.parameters.decimate
        offset = {f: self._range_offset[f][::n, ::n] for f in self.fingers}
        series = self._usable(frames, offset, "reference")
        self._refuse_another(series)
        cameras = {f: camera.decimated(n) for f, camera in self._full_cameras.items()}
        self._reference = Reference.taken(series, cameras, self._X_CX, offset, p)
        for f, picture in self._reference.picture.items():
            self.patterns[f] = identity.pattern(picture)
        self._forget_grasp(NO_GRASP)

    def initialize_grasp(self, frames: Sequence[Frame]) -> None:
        """The tool is grasped: T := C from these images on; two frames or more, with nothing moving, are averaged.

        A tool that hangs or is pressed meanwhile has dragged the membranes: then T is counted from where it would be
        without that load (`zero`), or the grasp is refused, as `loaded_grasp` says.

        Raises:
            EstimatorError: no reference, less than two usable images of a finger, images of another or upside down, a
                finger without contact, or too much load.
        """
        p, reference = self.parameters, self._reference
        if reference is None:
            raise EstimatorError("no reference: capture one with the bubbles touching nothing before a grasp")
        self._forget_grasp(REFUSED)  # also where the new one is refused: it was asked for since the old one is none
        series = self._usable(frames, reference.correction, "grasp")
        self._refuse_another(series)
        self._alive = Alive(series)
        grasp = Grasp.taken(series, reference, p)
        self.masks, self.patches, self.zero = grasp.masks, grasp.patches, grasp.zero
        if p.method in PATCH_METHODS:
            if len(self.fingers) < 2:
                raise EstimatorError(f"the {p.method} method needs both bubbles; use method 'rigid_fit' with one")
            self._patch_method = PATCH_METHODS[p.method](grasp.patches, grasp.ir, self._X_CX, p)
        else:
            finders = reference.finders.items()
            models = [finger_model(s, grasp.depth[f], grasp.ir[f], grasp.masks[f], p) for f, s in finders]
            timing = Timing(p.finger_skew_std, p.depth_lag_std)
            self._tracker = Tracker(models, {f: series[f][-1] for f in self.fingers}, p.max_slip, timing)
        self._stamp = self._touched = min(i[-1].stamp for i in series.values())

    def _usable(
        self, frames: Sequence[Frame], correction: Mapping[str, Image], purpose: str
    ) -> dict[str, list[TactileImages]]:
        """The good images of each finger, at the working resolution."""
        p = self.parameters
        return {
            f: [i.reduced(p.decimate, correction[f]) for i in usable_images(frames, f, camera, p, purpose)]
            for f, camera in self._full_cameras.items()
        }

    def _refuse_another(self, series: Mapping[str, list[TactileImages]]) -> None:
        """Raises EstimatorError: a finger's images are upside down or the other's, by the dots that are known."""
        for finger in self.fingers:
            mistake = identity.mistaken(finger, series[finger][-1].ir, self.patterns)
            if mistake:
                raise EstimatorError(mistake)

    def _forget_grasp(self, why: str) -> None:
        self._no_grasp = why
        self._tracker, self._patch_method, self._covariance = None, None, self._new_covariance()
        self._stamp, self.zero = -np.inf, NO_LOAD

    @property
    def _holds(self) -> bool:
        return self._tracker is not None or self._patch_method is not None

    def _new_covariance(self) -> Covariance:
        return Covariance(self._systematic())

    def _systematic(self) -> Systematic:
        return Systematic(self.parameters, {f: self._X_CX[f] for f in self.fingers}, self._mutual)

    @property
    def timing(self) -> Timing | None:
        """Skew of the fingers and lag of depth, as learnt in this grasp; None without one, or by another method."""
        return self._tracker.timing if self._tracker is not None else None

    @property
    def closing(self) -> float:
        """By how much each finger has come nearer to the tool since the grasp [m], as depth shows it; 0 without one."""
        return self._tracker.closing if self._tracker is not None else 0.0

    # -- at the frame rate -----------------------------------------------------------------------------------------

    def update(self, images: Frame, stamp: float) -> RelativePoseEstimate:
        """The tool's pose from one set of images; never raises on bad images.

        Args:
            images: of one time, by finger.
            stamp: that time [s], of the older finger's images; later than that of the images before.

        Returns:
            X_CT at `stamp` with covariance and the axes observed; or an estimate that is not valid, and its reason.
        """
        p = self.parameters

        # Checks: images/checks.py
        problem, reference = self._problem(images, stamp), self._reference
        reduced: dict[str, TactileImages] = {}
        if not problem and reference is not None:
            reduced = {f: images[f].reduced(p.decimate, reference.correction[f]) for f in self.fingers}
            problem = self._alive.problem(reduced) if self._holds else ""
        if problem or reference is None:
            self.patches, self.masks, self._images = {}, {}, {}  # what was seen before is not what is there now
            return self._invalid(stamp, problem)
        gap, self._stamp, self._images = stamp - self._stamp, stamp, reduced

        # Contact patches, Sec. VII-A: contact/patch.py
        for f, finder in (reference.quick if self._patch_method is None else reference.finders).items():
            self.masks[f], self.patches[f] = finder.find(self._images[f].depth, p)
        touching = [f for f in self.fingers if self.patches[f].in_contact]
        if touching or stamp < self._touched:
            self._touched = stamp
        elif self._holds and stamp - self._touched > report.LET_GO:  # what is held next is held otherwise
            self._forget_grasp(report.RELEASED)
            self._stamp = stamp

        # The paper's method, Sec. VII-B and C: published.py
        method = self._patch_method
        if method is not None:
            X_CT, reason = method.pose(self.patches, self._images, self.masks)
            if X_CT is None:
                return self._invalid(stamp, reason)
            return report.from_free(report.by_patches(stamp, X_CT, method, p.method), self.zero)

        # Fit of one rigid motion to all images, micro-slip and gross slip: tracker.py
        tracker = self._tracker
        if tracker is None:
            return self._invalid(stamp, self._no_grasp)
        if gap > p.max_gap:
            tracker.lose()
        fit = None if tracker.gross_slip else tracker.follow(self._images, stamp, touching, p)
        if fit is None or tracker.gross_slip:
            return self._invalid(stamp, report.SLIPPED)
        if tracker.lost:
            mistakes = (identity.mistaken(f, self._images[f].ir, self.patterns) for f in self.fingers)
            return self._invalid(stamp, next(filter(None, mistakes), report.lost_reason(fit, touching, p.lock)))

        # Covariance, and how far the tool has slid on the membranes: rigid_fit/covariance.py, rigid_fit/sliding.py
        covariance = self._covariance.update(fit, stamp, tracker.slip, tracker.timing)

        # Report: report.py
        estimate = report.rigid_fit(stamp, fit, covariance, self._covariance.creep, tracker, touching, p)
        sliding = self._covariance.sliding
        tracker.ahead = sliding.value
        if estimate.valid:
            estimate = report.slid(estimate, *sliding.of_pose(fit))
        estimate = replace(estimate, membrane=report.membranes(tracker.around, self.patches, p))
        return report.from_free(estimate, self.zero)

    def _problem(self, images: Frame, stamp: float) -> str:
        """Why images cannot be used, or ''."""
        if not np.isfinite(stamp):
            return f"stamp {stamp} is not a time"
        if stamp < self._stamp - SET_BACK:
            self._stamp = -np.inf
        elif stamp <= self._stamp:
            return (
                f"stamp {stamp:.6f} s is not later than the one before, {self._stamp:.6f} s: images came out of order"
            )
        no_reference = "" if self._reference is not None else "no reference: capture_reference has not been called"
        return frame_problem(images, self._full_cameras, self.parameters) or no_reference

    def _invalid(self, stamp: float, reason: str) -> RelativePoseEstimate:
        slipped = self._tracker is not None and self._tracker.gross_slip
        return report.invalid(stamp, reason, self.parameters.method, gross_slip=slipped)

    def debug_image(self) -> NDArray[np.uint8]:
        """(H, W, 3) uint8 BGR: infrared of each finger with contact outlined and motion drawn."""
        n, images = self.parameters.decimate, self._images
        shapes = {f: camera.decimated(n).shape for f, camera in self._full_cameras.items()}
        return np.hstack(
            [report.debug_image(f, s, images.get(f), self.masks, self._tracker) for f, s in shapes.items()]
        )
