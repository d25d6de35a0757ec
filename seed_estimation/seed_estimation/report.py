# SPDX-License-Identifier: Apache-2.0
"""What the estimator says about a frame: pose with honest covariance, axes observed, reasons, and a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array
from seed_estimation import published as published_method
from seed_estimation.contact.patch import ContactPatch, Mask
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.sampling import project32
from seed_estimation.images.tactile_images import TactileImages
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.tracker import Tracker

NO_POSE = 0.0524, 0.002  # [rad], [m] deviation of an axis from which on, though tracked, there is no pose to speak of
_DOUBT = np.pi  # [rad] or [m]: the deviation of what is not known


def invalid(stamp: float, reason: str, method: str, gross_slip: bool = False) -> RelativePoseEstimate:
    """An estimate that must not be used, and why."""
    return RelativePoseEstimate(
        stamp=stamp, X_CT=np.eye(4), covariance=np.eye(6) * _DOUBT**2, observed=(False,) * 6, valid=False,
        reason=reason, gross_slip=gross_slip, method=method,
    )  # fmt: skip


def published(stamp: float, X_CT: Array) -> RelativePoseEstimate:
    """An estimate by the paper's method, with the deviations it was measured to have."""
    covariance = np.diag(np.square(published_method.DEVIATION))
    return RelativePoseEstimate(stamp, X_CT, covariance, published_method.OBSERVED, method="published")


def rigid_fit(
    stamp: float, result: Fit, tracker: Tracker, patches: Mapping[str, ContactPatch], p: EstimatorParameters
) -> RelativePoseEstimate:
    """An estimate from a track that is locked."""
    sigma = tracker.covariance.of(result, tracker.slip)
    deviation = np.sqrt(np.diag(sigma))
    if deviation[:3].max() > NO_POSE[0] or deviation[3:].max() > NO_POSE[1]:
        angle, length = np.rad2deg(deviation[:3].max()), 1e3 * deviation[3:].max()
        reason = f"too little is in contact: the pose is known to {angle:.1f} degrees and {length:.1f} mm only"
        return invalid(stamp, reason, "rigid_fit")
    angles, lengths = deviation[:3] < p.max_std_rotation, deviation[3:] < p.max_std_translation
    unlocked = [f for f, share in result.locked.items() if share < p.lock]
    words = [f"{f} bubble {'is not followed' if patches[f].in_contact else 'touches nothing'}" for f in unlocked]
    if len(result.locked) < 2:
        words.append(f"reduced: {next(iter(result.locked))} finger only")
    if not (angles.all() and lengths.all()):
        words.append("some axes are not observed")
    seen = [bool(b) for b in (*lengths, *angles)]
    return RelativePoseEstimate(
        stamp=stamp, X_CT=result.X_CT, covariance=sigma,
        observed=(seen[0], seen[1], seen[2], seen[3], seen[4], seen[5]),
        reason="; ".join(words), slip=tracker.slip.value, method="rigid_fit",
    )  # fmt: skip


def lost_reason(result: Fit, patches: Mapping[str, ContactPatch], lock: float) -> str:
    """How badly the images fit."""
    if not any(patch.in_contact for patch in patches.values()):
        return "track lost: the tool touches no bubble; searching"
    shares = ", ".join(f"{f} {max(share, 0.0):.0%}" for f, share in result.locked.items())
    if min(result.locked.values()) >= lock:
        return f"track lost: depth contradicts the infrared images, of which {shares} are explained; searching"
    return f"track lost: the motion explains {shares} of the infrared images, below {lock:.0%}; searching"


def debug_image(
    fingers: Sequence[str],
    images: Mapping[str, TactileImages],
    cameras: Mapping[str, PinholeCamera],
    masks: Mapping[str, Mask],
    tracker: Tracker | None,
) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 BGR: the fingers side by side, contact outlined, motion since the grasp as lines."""
    panels = []
    for finger in fingers:
        if finger not in images:
            panels.append(np.zeros((*cameras[finger].shape, 3), np.uint8))
            continue
        panel = cv2.cvtColor(published_method.eight_bit(images[finger].ir), cv2.COLOR_GRAY2BGR)
        outline, _ = cv2.findContours(masks[finger], cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(panel, outline, -1, (80, 220, 80), 1)
        _draw_motion(panel, finger, tracker)
        panels.append(panel)
    return np.hstack(panels)


def _draw_motion(panel: NDArray[np.uint8], finger: str, tracker: Tracker | None) -> None:
    for m in tracker.models if tracker is not None and not tracker.lost else ():
        if m.finger != finger:
            continue
        assert tracker is not None
        X = m.X_XC @ tracker.X_CT
        p = m.levels[1].p[:, ::40]
        before = project32(m.camera, (m.X_XC[:3, :3] @ p + m.X_XC[:3, 3:]).astype(np.float32))
        after = project32(m.camera, (X[:3, :3] @ p + X[:3, 3:]).astype(np.float32))
        for a, b in zip(before.T, after.T, strict=True):
            if np.isfinite([*a, *b]).all():
                cv2.line(
                    panel,
                    (round(float(a[0])), round(float(a[1]))),
                    (round(float(b[0])), round(float(b[1]))),
                    (60, 160, 255),
                    1,
                )
