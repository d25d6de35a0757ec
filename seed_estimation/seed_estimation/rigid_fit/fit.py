# SPDX-License-Identifier: Apache-2.0
"""One rigid motion of the tool that explains the infrared images and the depth of both fingers at once.

Robust Gauss-Newton over xi = [rotation, translation] on the residuals of all fingers, coarse then fine. The membrane
may follow only a share 1 - slip of the motion across the camera's axis (micro-slip), which the image sees and depth
does not. Where the tool has slid on the membrane, the pose is that of the membrane's patches, and depth sees the tool
that far from there (`sliding.py`).

Cameras ride on the fingers. Where a gripper closes further, both see the tool nearer, which no motion of it explains.
So they do where the range of both drifts. One number more, `closing`, is found with the pose for that.
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
PRETENDED = 5e-5  # [m] of closing that noise and membranes that creep pretend
CLOSES = 3e-5  # [m] deviation of how far a finger closes between two frames; depth knows it three times as well
DONE = 2.0  # a step of less than this many deviations, as residuals that were independent would have them, is the last


@dataclass(frozen=True, eq=False)
class Fit:
    """Outcome of the fit.

    Attributes:
        X_CT: (4, 4) of the tool, were it to stick to its patches.
        ahead: (6,) [rotation, translation] by which patches are ahead of the tool, in its frame, as it was fitted.
        closing: [m] by which each finger has come nearer to the tool since the grasp.
        H, g: (6, 6) information about xi, in the tool's frame, that of the prior included, and (6,) gradient.
        H_depth, g_depth: those of the depth images alone; H^-1 g is where they would like to go.
        explained: share of each finger's image that the motion explains.
        depth_rms: robust deviation of the depth residuals of each finger [m]; infinite where too few are left.
        fingers: each finger's points, residuals and weights at the end.
    """

    X_CT: Array
    ahead: Array
    closing: float
    H: Array
    g: Array
    H_depth: Array
    g_depth: Array
    explained: Mapping[str, float]
    depth_rms: Mapping[str, float]
    fingers: Sequence[FingerResiduals]

    @property
    def closed(self) -> float:
        """[m] of the closing, as far as it is clearly more than what is pretended."""
        return self.closing**3 / (self.closing**2 + PRETENDED**2)

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
    closing: float = 0.0,
) -> Fit:
    """Pose of the tool from the fingers' images, started at X_CT (4, 4); slip: micro-slip [1].

    prior: (6, 6) information that holds unobserved axes where they start; steps: most steps, coarse and fine; course:
    where the tool is for a finger (by name) whose images are of another time; ahead: as of Fit; closing: the same, of
    the frame before, found anew with two fingers.
    """
    at = course or _same
    X_PT = make_pose(so3_exp(-ahead[:3]), -ahead[3:]) if ahead.any() else None
    X = X_CT
    for level, most in enumerate(steps):
        if most == 0:
            continue
        fingers = [FingerResiduals(m, crops[m.finger], at(X, m.finger), slip, level, X_PT) for m in models]
        X, closing = _descended(fingers, X, prior, most, at, closing)
    R = X[:3, :3]  # without the rounding of many products: one step of Newton's towards the nearest rotation
    X = make_pose(R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R)), X[:3, 3])
    H_depth, g_depth = sum(f.depth.H for f in fingers), sum(f.depth.g for f in fingers)
    return Fit(
        X_CT=X,
        ahead=ahead,
        closing=closing,
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


def _descended(
    fingers: Sequence[FingerResiduals], X: Array, prior: Array, steps: int, at: Course, before: float
) -> tuple[Array, float]:
    """Pose and closing after at most so many steps of Gauss-Newton, reweighted in each; before: [m] closing until now.

    With one finger, closing is a motion of the tool, and stays as it is.
    """
    closing, held = before, CLOSES**-2.0 if len(fingers) > 1 else 1e18
    for i in range(steps):
        H, g = np.zeros((7, 7)), np.zeros(7)
        H[:6, :6], H[6, 6], g[6] = prior, held, held * (closing - before)
        for finger in fingers:
            model = finger.model
            X_CT = at(X, model.finger)
            finger.evaluate(make_pose(X_CT[:3, :3], X_CT[:3, 3] + closing * model.outward), rescale=i < 2)
            H_f, g_f = finger.image.H + finger.depth.H, finger.image.g + finger.depth.g
            nearer = X_CT[:3, :3].T @ model.outward
            column = H_f[:, 3:] @ nearer
            H[:6, :6] += H_f
            H[:6, 6] += column
            H[6, 6] += nearer @ column[3:]
            g[:6] += g_f
            g[6] += nearer @ g_f[3:]
        H[6, :6] = H[:6, 6]
        step = solved(H, g)
        xi, closing = step[:6], closing - float(step[6])
        R = so3_exp(xi[:3]).T
        X = X @ make_pose(R, -R @ xi[3:])  # X_CT exp(xi)^-1
        if step @ g < DONE**2:
            break
    return X, closing
