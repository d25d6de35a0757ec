# SPDX-License-Identifier: Apache-2.0
"""What the cameras get wrong all the time, carried into the pose: mounts, focal length, scale and offset of depth.

A camera that is not what it is taken for sees each point x of its optical frame at x + f(x). The fit compares now with
the moment of grasp, T := C, when everything was wrong alike. So what is left of it after a motion x' = R x + t is

    d(x) = f(x') - R f(x)          0 without motion, growing with it

    turn of the mount  a_i x x        shift  a_i        focal length  (x, y, 0)        scale  x        offset  x / z

With J the residuals' Jacobian and H the information, the pose errs by H^-1 J W J_t d per unit of f, first order. A
mount's f is a motion of the whole, so that its d is one, too: Ad(M)^-1 - I for a motion M. These errors stay what they
are for a whole grasp: neither cells of one frame nor frames of one grasp contradict them.
"""

from collections.abc import Mapping

import numpy as np

from seed_core.spatial import Array, inverse_pose, motion_adjoint
from seed_estimation.images.tactile_images import Array32
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.rigid_fit.fit import Fit
from seed_estimation.rigid_fit.residuals import FingerResiduals, Residuals

MOUNT = 6  # errors of a mount: turns about the optical frame's x, y, z [rad], shifts along them [m]
SOME = 4  # every so many points tell what lens and range do
COUNT = MOUNT + 3  # of a finger: mount, focal length [1], scale of depth [1], offset of depth [m]


def deviations(p: EstimatorParameters) -> Array:
    """(COUNT,) of one finger's errors, in their units."""
    turn, shift = [p.mount_rotation_std] * 3, [p.mount_position_std] * 3
    return np.array([*turn, *shift, p.focal_std, p.depth_scale_std, p.depth_offset_std])


class Systematic:
    """Errors of the cameras of one hand, as far as they are known.

    Attributes:
        fingers: in the order of `covariance`.
        covariance: (n, n) of the errors, COUNT of each finger.
    """

    def __init__(self, p: EstimatorParameters, X_CX: Mapping[str, Array], mutual: Array | None = None) -> None:
        """X_CX: pose (4, 4) of each camera; mutual: (6,) deviations [rad, m] in C of how both lie to each other, if
        that was calibrated. Where C lies between them remains as unknown as before.
        """
        self.fingers = tuple(X_CX)
        self.covariance = np.diag(np.tile(np.square(deviations(p)), len(X_CX)))
        if mutual is None or len(X_CX) < 2:
            return
        B = np.zeros((6, self.covariance.shape[0]))
        for i, sign in enumerate((1.0, -1.0)):
            B[:, i * COUNT : i * COUNT + MOUNT] = sign * motion_adjoint(X_CX[self.fingers[i]])
        P = self.covariance
        gain = np.linalg.solve(B @ P @ B.T + np.diag(np.square(mutual)), B @ P).T
        self.covariance = P - gain @ B @ P

    def gradients(self, fit: Fit) -> tuple[Array, Array]:
        """(6, n) change with the errors of the gradient of all infrared images, and of all depth images."""
        by_finger = {f.model.finger: f for f in fit.fingers}
        image, depth = zip(*(gradients(by_finger[name], fit.X_CT) for name in self.fingers), strict=True)
        return np.hstack(image), np.hstack(depth)

    def of_pose(self, fit: Fit, by_error: tuple[Array, Array]) -> Array:
        """(6, 6) by which they make a fit's pose uncertain, [rotation, translation] in the tool's frame.

        by_error: as `gradients` gives it.
        """
        S = np.linalg.solve(fit.H, by_error[0] + by_error[1])
        return np.asarray(S @ self.covariance @ S.T)


def gradients(finger: FingerResiduals, X_CT: Array) -> tuple[Array, Array]:
    """(6, COUNT) change with its camera's errors of one finger's gradient g, of its image and of its depth.

    X_CT: (4, 4) where it is evaluated.
    """
    model = finger.model
    X_TX = inverse_pose(model.X_XC)  # at the grasp, T = C
    motion = model.X_XC @ X_CT @ X_TX  # in the optical frame
    by_mount = motion_adjoint(X_TX) @ (motion_adjoint(inverse_pose(motion)) - np.eye(6))
    R, t = motion[:3, :3].astype(np.float32), motion[:3, 3:].astype(np.float32)
    R_TX = (X_TX[:3, :3] @ motion[:3, :3].T).astype(np.float32)  # from the optical frame now to the tool
    R_XT, t_XT = model.X_XC[:3, :3].astype(np.float32), model.X_XC[:3, 3:].astype(np.float32)

    def of(residuals: Residuals, p: Array32) -> Array:
        out = np.zeros((6, COUNT))
        out[:, :MOUNT] = residuals.H @ by_mount
        if residuals.r.size == 0:
            return out
        x = R_XT @ p[:, ::SOME] + t_XT
        moved = R @ x + t
        x_flat, moved_flat = x.copy(), moved.copy()
        x_flat[2] = moved_flat[2] = 0.0
        slope = R_TX.T @ residuals.J[3:, ::SOME]  # of the residual, in the optical frame now
        d = (moved_flat - R @ x_flat, moved - R @ x, moved / moved[2] - R @ (x / x[2]))
        columns = np.stack([(slope * one).sum(axis=0) for one in d], axis=1)
        out[:, MOUNT:] = (residuals.Jw[:, ::SOME] @ columns).astype(float) * (SOME * residuals.scale)
        return out

    return of(finger.image, finger.points.p), of(finger.depth, finger.depth_points)
