# SPDX-License-Identifier: Apache-2.0
"""Report of a frame: pose with honest covariance, axes observed, reasons, and a picture."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.estimate import NO_TOUCH, MembraneMotion, RelativePoseEstimate
from seed_core.spatial import Array, both, inverse_pose
from seed_estimation.contact.grasp_zero import GraspZero
from seed_estimation.contact.patch import ContactPatch
from seed_estimation.images.tactile_images import Mask, TactileImages
from seed_estimation.material.motion import BAND_GOES, BAND_TURNS, MaterialMotion
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.published import PublishedMethod, eight_bit
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.tracker import Tracker

SLIPPED = "the tool has slipped in the grasp: initialize the grasp again"
LET_GO = 1.0  # [s] without touch, after which the gripper has been empty
RELEASED = f"no grasp: {NO_TOUCH}, or has not for a while; initialize the grasp again"
NO_POSE = 0.0524, 0.002  # [rad], [m] deviation of an axis from which on, though tracked, there is no pose to speak of
UNSURE = 0.1  # [1] deviation of the share of a patch's shift by which the band around it goes along
UNSURE_TURN = 0.15  # [1] likewise, of its turn
_DOUBT = np.pi  # [rad] or [m]: the deviation of what is not known


def invalid(stamp: float, reason: str, method: str, gross_slip: bool = False) -> RelativePoseEstimate:
    """An estimate that must not be used, and why."""
    return RelativePoseEstimate(
        stamp=stamp, X_CT=np.eye(4), covariance=np.eye(6) * _DOUBT**2, observed=(False,) * 6, valid=False,
        reason=reason, gross_slip=gross_slip, method=method,
    )  # fmt: skip


def by_patches(stamp: float, X_CT: Array, method: PublishedMethod, name: str) -> RelativePoseEstimate:
    """An estimate from both contact patches, by the paper's method or another one, with the deviation it states."""
    return RelativePoseEstimate(stamp, X_CT, np.diag(np.square(method.deviation)), method.observed, method=name)


def rigid_fit(
    stamp: float,
    fit: Fit,
    covariance: Array,
    creep: Array,
    tracker: Tracker,
    touching: Collection[str],
    p: EstimatorParameters,
) -> RelativePoseEstimate:
    """An estimate by the rigid fit, from a track that is locked, of a tool that sticks to its membranes.

    covariance: (6, 6) of [rotation vector in C, translation in C]; creep: (6,) variances in it that do not say that an
    axis is not seen; touching: fingers whose depth shows a contact.
    """
    seen = covariance - np.diag(creep)
    deviation = np.sqrt(np.diag(seen))
    if deviation[:3].max() > NO_POSE[0] or deviation[3:].max() > NO_POSE[1]:
        angle, length = np.rad2deg(deviation[:3].max()), 1e3 * deviation[3:].max()
        reason = f"too little is in contact: the pose is known to {angle:.1f} degrees and {length:.1f} mm only"
        return invalid(stamp, reason, "rigid_fit")
    followed = {f for f, motion in tracker.patches.items() if motion.explained > 0.0}
    unlocked = [f for f, share in fit.explained.items() if share < p.lock and not (f in touching and f in followed)]
    words = [f"{f} bubble {'is not followed' if f in touching else 'touches nothing'}" for f in unlocked]
    if len(fit.explained) < 2:
        words.append(f"reduced: {next(iter(fit.explained))} finger only")
    observed = _observed(seen, p)
    if not all(observed):
        words.append("some axes are not observed")
    words += tracker.timing.words()
    X_CT, slip = tracker.timing.corrected(fit.X_CT), tracker.slip.value
    return RelativePoseEstimate(
        stamp, X_CT, covariance, observed, reason="; ".join(words), slip=slip, method="rigid_fit"
    )


def slid(estimate: RelativePoseEstimate, X_PT: Array, covariance: Array) -> RelativePoseEstimate:
    """An estimate of a tool that sticks to its membranes, moved by how far it has slid on them.

    X_PT: (4, 4); covariance: (6, 6) of [rotation, translation] in the tool's frame.
    """
    R = both(estimate.X_CT[:3, :3])
    in_C = R @ covariance @ R.T
    turn, way = np.sqrt(in_C.diagonal()[:3].max()), np.sqrt(in_C.diagonal()[3:].max())
    reason = estimate.reason
    if turn > NO_POSE[0] or way > NO_POSE[1]:
        told = f"it may have slid on the membranes: how far is known to {np.rad2deg(turn):.0f} degrees"
        reason = "; ".join(filter(None, (reason, f"{told} and {1e3 * way:.1f} mm")))
    return replace(
        estimate, X_CT=estimate.X_CT @ X_PT, covariance=estimate.covariance + in_C, reason=reason,
        X_PT=X_PT, covariance_PT=in_C,
    )  # fmt: skip


def membranes(
    motions: Mapping[str, MaterialMotion], patches: Mapping[str, ContactPatch], p: EstimatorParameters
) -> tuple[MembraneMotion, ...]:
    """What the membranes do, by finger: motion of the material around each patch, and the patch itself."""
    return tuple(
        MembraneMotion(
            finger=finger,
            X_CM=motion.X_CM,
            covariance=motion.covariance,
            observed=_observed(motion.covariance, p),
            deformation=motion.deformation,
            area=patches[finger].area,
            centroid=patches[finger].centroid_C,
            indentation=patches[finger].mean_indentation,
        )
        for finger, motion in motions.items()
    )


def from_free(estimate: RelativePoseEstimate, zero: GraspZero) -> RelativePoseEstimate:
    """Counted from where the tool would have been without load when its grasp was taken."""
    if not zero.loaded or not estimate.valid:
        return estimate
    X = zero.motion_since_free()
    return replace(
        estimate,
        X_CT=estimate.X_CT @ X,
        X_PT=inverse_pose(X) @ estimate.X_PT @ X,
        covariance=estimate.covariance + zero.covariance,
        membrane=tuple(_band_from_free(m, zero) for m in estimate.membrane),
    )


def _band_from_free(band: MembraneMotion, zero: GraspZero) -> MembraneMotion:
    """Likewise of the band around a patch, which goes along with the tool in part."""
    share = np.concatenate((np.full(3, BAND_TURNS), BAND_GOES))
    unsure = np.concatenate((UNSURE_TURN * zero.turn, UNSURE * zero.patch_shift(band.finger)))
    return replace(
        band,
        X_CM=band.X_CM @ zero.part_since_free(band.finger, BAND_GOES, BAND_TURNS),
        covariance=band.covariance + np.outer(share, share) * zero.covariance + np.diag(np.square(unsure)),
    )


def _observed(covariance: Array, p: EstimatorParameters) -> tuple[bool, bool, bool, bool, bool, bool]:
    """Whether x, y, z, roll, pitch, yaw are seen, from a covariance (6, 6) of [rotation vector, translation]."""
    deviation = np.sqrt(np.diag(covariance))
    x, y, z = (bool(d < p.max_std_translation) for d in deviation[3:])
    roll, pitch, yaw = (bool(d < p.max_std_rotation) for d in deviation[:3])
    return x, y, z, roll, pitch, yaw


def lost_reason(fit: Fit, touching: Collection[str], lock: float) -> str:
    """Why a track is lost: how badly the best fit explains the images."""
    if not touching:
        return f"track lost: {NO_TOUCH}; searching"
    shares = ", ".join(f"{f} {max(share, 0.0):.0%}" for f, share in fit.explained.items())
    if min(fit.explained.values()) >= lock:
        return f"track lost: depth contradicts the infrared images, of which {shares} are explained; searching"
    return f"track lost: the motion explains {shares} of the infrared images, below {lock:.0%}; searching"


def debug_image(
    finger: str,
    shape: tuple[int, int],
    images: TactileImages | None,
    masks: Mapping[str, Mask],
    tracker: Tracker | None,
) -> NDArray[np.uint8]:
    """One finger's infrared image (H, W, 3) uint8 BGR, contact outlined, motion since the grasp as lines.

    shape: (H, W) of the image, black where there is none.
    """
    if images is None:
        return np.zeros((*shape, 3), np.uint8)
    panel: NDArray[np.uint8] = cv2.cvtColor(eight_bit(images.ir), cv2.COLOR_GRAY2BGR)
    outline, _ = cv2.findContours(masks[finger], cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(panel, outline, -1, (80, 220, 80), 1)
    if tracker is not None and not tracker.lost:
        model = next(m for m in tracker.models if m.finger == finger)
        p = model.levels[1].p[:, ::40]
        lines = np.stack((model.pixels(np.eye(4), p), model.pixels(tracker.X_CT, p)), axis=1).T  # (N, 2, 2)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        cv2.polylines(panel, list(np.rint(lines).astype(np.int32)), False, (60, 160, 255), 1)
        if finger in tracker.patches:
            _draw_material(panel, model, tracker.patches[finger])
    return panel


def _draw_material(panel: NDArray[np.uint8], model: FingerModel, motion: MaterialMotion) -> None:
    """Some points where the membrane's material has gone: where they leave the ends of the tool's lines, it slips."""
    for u, v in model.pixels(motion.X_CM, model.levels[1].p[:, ::40]).T:
        if np.isfinite((u, v)).all():
            cv2.circle(panel, (round(float(u)), round(float(v))), 1, (255, 220, 60), -1)
