# SPDX-License-Identifier: Apache-2.0
"""Micro-slip: Assumption 1 of the paper (no slip) is checked, not assumed.

While the tool moves, the membrane in contact follows a constant share of its motion along the surface. The image sees
the membrane and depth sees the tool, so wherever depth sees the motion at all, the share that the membrane does not
follow can be learnt: a scalar Kalman filter, of a second or so. Depth's own errors pretend a share of a per cent where
there is none, so an estimate is shrunk as far as it is not clearly more than its deviation; smoothly, because a pose
must not jump.

Gross slip, where the membrane lets go altogether, is in `slip/gross.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seed_core.spatial import Array
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.residuals import Residuals, motion_vector, solved

START_DEVIATION = 0.10  # [1] bubbles stick, as a rule
WANDER = 0.02  # [1/sqrt(s)] how fast the share may change
DOUBT = 20.0  # pixels are not independent: a frame's information counts this much less
SYSTEMATIC = 0.02  # [1] what depth's own errors pretend, however sure the images are
ALIKE = 0.25  # [s] over which those errors stay what they are: so much of the motion tells a share once
LARGEST_STEP = 0.5  # [1] that one frame may make


class ShareInformation(NamedTuple):
    """What images tell of a share s (0 to 1) of the motion that the membrane does not follow, the pose being free.

    Attributes:
        gradient, information: of s [1]; gradient / information is the Gauss-Newton step of s.
        effect: (6,) d xi / d s, by how much the pose [rotation, translation] changes with s.
    """

    gradient: float
    information: float
    effect: Array


def share_information(images: Sequence[Residuals], columns: Sequence[Array32], H: Array, g: Array) -> ShareInformation:
    """The share's own information once the pose is eliminated (Schur's complement).

    images: residuals of the fingers' images; columns: (N,) d r / d s of each; H (6, 6), g (6,): of the pose.
    """
    H_s, H_ss, g_s = np.zeros(6), 0.0, 0.0
    for image, column in zip(images, columns, strict=True):
        if image.r.size == 0:
            continue
        H_s += (image.Jw @ column) * image.scale
        H_ss += float(column @ (image.w * column)) * image.scale
        g_s += float(column @ (image.w * image.r)) * image.scale
    effect = solved(H, H_s)
    return ShareInformation(g_s - float(g @ effect), max(H_ss - float(H_s @ effect), 0.0), effect)


def micro_slip_information(
    images: Sequence[Residuals], J_along: Sequence[Array32], X_CT: Array, H: Array, g: Array
) -> ShareInformation:
    """What the images tell of the micro-slip: residuals change with it by what the motion X_CT (4, 4) does sideways.

    J_along: (6, N) Jacobian of each image with sideways motion; H, g: as above.
    """
    motion = motion_vector(X_CT).astype(np.float32)
    return share_information(images, [motion @ J for J in J_along], H, g)


@dataclass
class MicroSlip:
    """Share of the tool's motion that the membrane does not follow.

    Attributes:
        most: largest value that is corrected for [1].
        estimate, variance: of the filter [1].
        value: what is corrected for [1].
    """

    most: float
    estimate: float = 0.0
    variance: float = START_DEVIATION**2
    value: float = 0.0

    def update(self, evidence: ShareInformation, dt: float) -> None:
        """Takes what one frame tells, about the present value; dt: since the frame before [s]."""
        self.variance = min(self.variance + WANDER**2 * max(dt, 0.0), START_DEVIATION**2)
        step = evidence.gradient / max(evidence.information, 1e-9)
        if dt <= 0.0 or evidence.information <= 0.0 or not np.isfinite(step):
            return
        systematic = SYSTEMATIC**2 * max(ALIKE / dt, 1.0)
        gain = self.variance / (self.variance + DOUBT / evidence.information + systematic)
        wanted = self.value + min(max(step, -LARGEST_STEP), LARGEST_STEP)
        self.estimate = max(self.estimate + gain * (wanted - self.estimate), 0.0)  # no membrane runs ahead of the tool
        self.variance *= 1.0 - gain
        self.value = min(self.estimate**3 / (self.estimate**2 + self.variance), self.most)

    @property
    def deviation(self) -> float:
        """Of the value [1]: what the filter does not know, or does not correct."""
        return float(np.hypot(np.sqrt(self.variance), self.estimate - self.value))
