# SPDX-License-Identifier: Apache-2.0
"""What an estimate shows of slip."""

from math import isfinite, nan

import numpy as np

from seed_control.grip.margin import SlipSigns
from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.spatial import Array

_LEAST = 3e-4  # [m] of motion along the patches, below which a share of it says nothing


def signs_of(estimate: RelativePoseEstimate) -> SlipSigns:
    """Its micro-slip, or what the membranes' material does not follow in this image if that is more.

    A share that is learnt over a second comes too late for a pull; what the material does is of this image alone.
    """
    shares = [s for m in estimate.membrane if isfinite(s := _left_behind(m, estimate.X_CT))]
    if not (estimate.membrane or estimate.slip > 0.0):  # this estimator tells of no slip
        return SlipSigns(gross=estimate.gross_slip)
    slip = max(estimate.slip, float(np.mean(shares)) if shares else 0.0)
    return SlipSigns(slip, gross=estimate.gross_slip)


def _left_behind(m: MembraneMotion, X_CT: Array) -> float:
    """Share of the tool's motion along the patch that its material does not follow; not a number for next to none."""
    p = m.centroid if np.isfinite(m.centroid).all() else np.zeros(3)
    tool = (X_CT[:3, :3] @ p + X_CT[:3, 3] - p)[::2]
    material = (m.X_CM[:3, :3] @ p + m.X_CM[:3, 3] - p)[::2]
    size = float(tool @ tool)
    return max(float((tool - material) @ tool) / size, 0.0) if size > _LEAST**2 else nan
