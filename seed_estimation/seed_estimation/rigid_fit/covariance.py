# SPDX-License-Identifier: Apache-2.0
"""Covariance of a fit: from what contradicts itself in the images, not from their noise alone.

Residuals of neighbouring pixels err alike (blurred markers, smooth range errors, shading), so the inverse of the
information H promises too much. The patches are cut into cells whose errors count as independent; with g_c the
gradient of cell c, sum over c of H^-1 g_c g_c^T H^-1 is what the fit's error scatters by (a sandwich estimator with
clusters; Liang and Zeger 1986). What it is larger than H^-1 by is averaged over a few frames, because a few dozen cells
tell a variance roughly only: with H = L L^T, the average is of L^-1 (sum of g_c g_c^T) L^-T. So it follows at once when
one camera sees less.

What no image contradicts, because mounts, lenses and ranges are wrong all the time, comes from `systematic.py`, and
what a creeping membrane hides from `creep.py`. All that is of a tool that sticks to its membranes; how far it has slid
on them is in `sliding.py`.
"""

import numpy as np

from seed_core.spatial import Array, both, so3_log
from seed_estimation.rigid_fit.creep import Creep
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.micro_slip import MicroSlip
from seed_estimation.rigid_fit.sliding import Sliding
from seed_estimation.rigid_fit.systematic import Systematic
from seed_estimation.rigid_fit.timing import Timing

# Chosen on rendered bubbles, seeds 901, 951 and 952; docs/estimation_figures.md has the outcome on others
SCATTER = 0.65  # [1] deviations of how far cells contradict each other: errors of neighbours cancel in part
OWN = 0.25  # [1] deviations of the fit's own information
LEARNT = 0.02  # [1] deviation from which a micro-slip counts as known
ROUGH = 0.2  # [1] share of what is not known of it that works in any direction
UNEVEN = 0.045  # [1] share of what is corrected that does: no patch slips by the same share all over
HIDDEN = 0.4  # [1] an image of which less is explained shows something else, or nothing
ALONE = 2.0  # [1] deviations so much larger as soon as one of two images is hidden: what it balanced shows up
REMAINING = 0.3  # [1] share of the patch of the grasp; a single finger that touches less of it errs as one left alone
MEMORY = 0.05  # weight of one frame in the average
UNLIKE = 0.5  # [1] of what both fingers' depth has drifted by, in which they may have drifted differently


class Covariance:
    """Of the poses that are found in one grasp.

    Attributes:
        systematic: errors of the cameras.
        creep: (6,) variances in the last one that are doubt about the membrane, not about what the images show.
        sliding: how far the tool has slid on the membranes.
    """

    def __init__(self, systematic: Systematic) -> None:
        self.systematic = systematic
        self._creep, self.sliding = Creep(), Sliding()
        self.creep = np.zeros(6)
        self._excess: Array | None = None  # average of L^-1 (sum of g_c g_c^T) L^-T

    def update(self, fit: Fit, stamp: float, slip: MicroSlip, timing: Timing) -> Array:
        """(6, 6) of [rotation vector in C, translation in C] of a fit that is believed, were the tool to stick.

        stamp: of its images [s]; slip, timing: after it.
        """
        root = np.linalg.inv(np.linalg.cholesky(fit.H))
        of_images = np.asarray(sum(finger.image.scatter() for finger in fit.fingers))
        of_depth = np.asarray(sum(finger.depth.scatter() for finger in fit.fingers))
        excess = root @ (of_images + of_depth) @ root.T
        if self._excess is None:
            self._excess = excess
        self._excess = self._excess + MEMORY * (excess - self._excess)
        C = root.T @ (OWN**2 * np.eye(6) + SCATTER**2 * self._excess) @ root
        effect = fit.slip_information.effect
        C = (ALONE**2 if _alone(fit) else 1.0) * C + slip.deviation**2 * np.outer(effect, effect)
        by_error = self.systematic.gradients(fit)
        C += self.systematic.of_pose(fit, by_error) + timing.covariance
        self.sliding.update(fit, stamp, slip, of_depth, by_error, self.systematic.covariance)
        R = both(fit.X_CT[:3, :3])
        C = R @ C @ R.T
        unknown = max(slip.variance - LEARNT**2, 0.0)
        turn, way = np.linalg.norm(so3_log(fit.X_CT[:3, :3])), np.linalg.norm(fit.X_CT[:3, 3])
        anywhere = ROUGH**2 * unknown + UNEVEN**2 * slip.value**2
        C += anywhere * np.diag(np.square((turn, turn, turn, way, way, way)))
        self.creep = self._creep.update(fit)
        C += np.diag(self.creep)
        C[4, 4] += (UNLIKE * fit.closed) ** 2
        return np.asarray(0.5 * (C + C.T))


def _alone(fit: Fit) -> bool:
    """Whether one finger bears the pose with nothing to balance what it gets wrong."""
    if len(fit.fingers) > 1:
        return min(fit.explained.values()) < HIDDEN
    finger = fit.fingers[0]
    return finger.depth.r.size < REMAINING * finger.model.n_p.size
