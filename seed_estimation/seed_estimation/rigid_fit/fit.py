# SPDX-License-Identifier: Apache-2.0
"""One rigid motion of the tool that explains the infrared images and the depth of both fingers at once.

Robust Gauss-Newton over xi = [rotation, translation] on the residuals of all fingers, coarse then fine. The membrane
may follow only a share 1 - slip of the motion across the camera's axis (micro-slip), which the image sees and depth
does not. Where the tool has slid on the membrane, the pose is that of the membrane's patches, and depth sees the tool
that far from there (`sliding.py`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp
from seed_estimation.images.sampling import Crop
from seed_estimation.rigid_fit.micro_slip import ShareInformation, micro_slip_information
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import FingerResiduals, solved

Course = Callable[[Array, str], Array]
_STICKS = np.zeros(6)
DONE = 2.0  # a step of less than this many deviations, as residuals that were independent would have them, is the last


@dataclass(frozen=True, eq=False)
class Fit:
    """Outcome of the fit.

    Attributes:
        X_CT: (4, 4) of the tool, were it to stick to its patches.
        ahead: (6,) [rotation, translation] by which patches are ahead of the tool, in its frame, as it was fitted.
        H, g: (6, 6) information about xi, in the tool's frame, that of the prior included, and (6,) gradient.
        H_depth, g_depth: those of the depth images alone; H^-1 g is where they would like to go.
        explained: share of each finger's image that the motion explains.
        depth_rms: robust deviation of the depth residuals of each finger [m]; infinite where too few are left.
        fingers: each finger's points, residuals and weights at the end.
    """

    X_CT: Array
    ahead: Array
    H: Array
    g: Array
    H_depth: Array
    g_depth: Array
    explained: Mapping[str, float]
    depth_rms: Mapping[str, float]
    fingers: Sequence[FingerResiduals]

    @cached_property
    def slip_information(self) -> ShareInformation:
        """By how much the images ask to change the micro-slip."""
        images, J_along = [f.image for f in self.fingers], [f.points.J_along for f in self.fingers]
        return micro_slip_information(images, J_along, self.X_CT, self.H, self.g)


def fit(
    models: Sequence[FingerModel],
    crops: Mapping[str, Crop],
    X_CT: Array,
    slip: float,
    prior: Array,
    steps: tuple[int, int],
    course: Course | None = None,
    ahead: Array = _STICKS,
) -> Fit:
    """Pose of the tool from the fingers' images, started at X_CT (4, 4); slip: micro-slip [1].

    prior: (6, 6) information that holds unobserved axes where they start; steps: most steps, coarse and fine; course:
    where the tool is for a finger (by name) whose images are of another time; ahead: as of Fit.
    """
    at = course or _same
    X_PT = make_pose(so3_exp(-ahead[:3]), -ahead[3:]) if ahead.any() else None
    X = X_CT
    for level, most in enumerate(steps):
        if most == 0:
            continue
        fingers = [FingerResiduals(m, crops[m.finger], at(X, m.finger), slip, level, X_PT) for m in models]
        X = _descended(fingers, X, prior, most, at)
    R = X[:3, :3]  # without the rounding of many products: one step of Newton's towards the nearest rotation
    X = make_pose(R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R)), X[:3, 3])
    H_depth, g_depth = sum(f.depth.H for f in fingers), sum(f.depth.g for f in fingers)
    return Fit(
        X_CT=X,
        ahead=ahead,
        H=np.asarray(sum(f.image.H for f in fingers) + H_depth + prior),
        g=np.asarray(sum(f.image.g for f in fingers) + g_depth),
        H_depth=np.asarray(H_depth),
        g_depth=np.asarray(g_depth),
        explained={f.model.finger: f.explained() for f in fingers},
        depth_rms={f.model.finger: f.depth.deviation if f.depth.r.size else np.inf for f in fingers},
        fingers=fingers,
    )


def _same(X_CT: Array, finger: str) -> Array:
    del finger
    return X_CT


def _descended(fingers: Sequence[FingerResiduals], X: Array, prior: Array, steps: int, at: Course) -> Array:
    """The pose after at most so many steps of Gauss-Newton, reweighted in each."""
    for i in range(steps):
        H, g = prior.copy(), np.zeros(6)
        for finger in fingers:
            finger.evaluate(at(X, finger.model.finger), rescale=i < 2)
            H += finger.image.H + finger.depth.H
            g += finger.image.g + finger.depth.g
        xi = solved(H, g)
        R = so3_exp(xi[:3]).T
        X = X @ make_pose(R, -R @ xi[3:])  # X_CT exp(xi)^-1
        if xi @ g < DONE**2:
            break
    return X
