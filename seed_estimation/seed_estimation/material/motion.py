# SPDX-License-Identifier: Apache-2.0
"""How the material of one finger's membrane has moved since the grasp: the membrane is the spring, the tool is not.

Points p of the patch at the grasp are followed by their dots and lie on the membrane that depth shows, whether the tool
still touches them or not, and whether they stick to it or not. They move as

    q = X (p + F powers(p)),    X a rigid motion, F (3, 6) a smooth field in powers 1, u, v, u^2, u v, v^2

Robust Gauss-Newton finds F from the fine infrared image of the grasp (r = I_t(q) - I_0(p)) and from depth (distance of
q along its normal from the membrane) with Jacobians that are made once, for p. X is where the tool's last motion would
have brought the material; after a frame it becomes the rigid part of what was found, the least sum of squares over the
patch, so F stays the small remainder.

Where the dots of a finger are not found for a moment, its material is taken to move as the tool does, and is known the
worse the longer that lasts and the further the tool goes.
"""

from typing import NamedTuple

import numpy as np

from seed_core.membrane.material import Patch, deformation, patch_of, rigid_motion
from seed_core.spatial import Array, inverse_pose, skew, so3_log
from seed_estimation.images.sampling import Crop, sample
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.reference import FingerModel
from seed_estimation.rigid_fit.residuals import (
    DEPTH_COMMON,
    DEPTH_FLOOR,
    FEW,
    IMAGE_FLOOR,
    SHARE_DEPTH,
    SHARE_IMAGE,
    Residuals,
    solved,
)

UNKNOWNS = 18  # 3 axes, 6 powers
STRAIN = 1e-3  # [m] deviation of what bends the patch, before anything is seen: hardly more than 1e-3 is met
STEPS = 3  # at most, of one frame
DONE = 2e-5  # [m] of the patch's mean motion in one step: the next would be a fraction of it
FOUND = 0.5  # [1] of the image that the motion explains where it is found well
PART = 0.25  # [1] that it must explain: friction lets a patch go in pieces, which no smooth field follows
PATCHY = 0.0005  # [m] by which the patch's motion is uncertain then
OWN = 0.5  # [1] deviations of the fit's own information
UNCLEAR = 0.2  # [1] share of what is not rigid by which the rigid part is uncertain
SCATTER = 0.65  # [1] deviations of how far pieces of the patch contradict each other
ASSUMED = 0.0003, 0.5  # [m] and share of the tool's way since, by which material that is not found may be elsewhere
FRAMES = 8  # for which it is assumed at most
ONE = np.float32(1.0)


class MaterialMotion(NamedTuple):
    """Motion of the patch's material since the grasp.

    Attributes:
        X_CM: (4, 4) its rigid part.
        covariance: (6, 6) of [rotation vector in C, translation in C].
        deformation: (9,) [m] as of `MembraneMotion`.
        explained: share of the image that it explains; 0 where it is assumed, not found.
    """

    X_CM: Array
    covariance: Array
    deformation: Array
    explained: float


class MaterialTracker:
    """Follows the material of one finger's patch from frame to frame, in one grasp."""

    def __init__(self, model: FingerModel) -> None:
        points = model.material
        self.model, self._p, self._n = model, points.p, points.n
        self._value = points.value
        self.patch: Patch = patch_of(model.patch)
        self._powers = self.patch.powers(points.p).astype(np.float32)  # (6, N)
        slope = (points.J_along + points.J_rest)[3:]  # of the image in space
        self._image = Residuals(self._spread(slope), points.cells, SHARE_IMAGE, IMAGE_FLOOR)
        self._depth = Residuals(self._spread(points.n), points.cells, SHARE_DEPTH, DEPTH_FLOOR, DEPTH_COMMON)
        self._area = model.patch.astype(float)  # (3, M) evenly over the patch
        self._area_powers = self.patch.powers(model.patch)
        self._field_of = np.linalg.pinv(self._area_powers)  # (M, 6)
        self._rigid_of = self._rigid_part()
        bends = np.array((0.0, *(STRAIN**-2,) * 5))
        self._prior = np.diag(np.concatenate([bends] * 3))
        self._X, self._F = np.eye(4), np.zeros((3, 6))
        self._found: MaterialMotion | None = None  # last
        self._missed, self._way = 0, 0.0  # frames since, and how far the tool has gone in them [m]
        self.lost = False

    def _spread(self, direction: Array32) -> Array32:
        """(18, N) change of a value with F from its change with a point's place (3, N)."""
        J = direction[:, None, :] * self._powers[None]
        return np.ascontiguousarray(J.reshape(UNKNOWNS, -1), np.float32)

    def _rigid_part(self) -> Array:
        """(6, 18) [rotation vector, translation] that fits a small field best over the patch."""
        p, powers = self._area, self._area_powers
        motion = np.concatenate([np.hstack((-skew(x), np.eye(3))) for x in p.T])  # (3 M, 6)
        field = np.einsum("kl,am->mkla", np.eye(3), powers).reshape(-1, UNKNOWNS)  # (3 M, 18)
        return np.asarray(np.linalg.lstsq(motion, field, rcond=None)[0])

    def follow(self, crop: Crop, step: Array, X_CT: Array) -> MaterialMotion | None:
        """The motion in a frame, or None where the material has not been found for some frames.

        step: (4, 4) how the tool has moved in C since the frame before; X_CT: where it is now.
        """
        starts = [(X_CT, np.zeros((3, 6)))]
        if not self.lost:
            starts.insert(0, (step @ self._X, self._F))
        tried: list[tuple[float, Array, Array]] = []
        for X, F in starts:
            F = self._descended(crop, X, F)
            explained = self._explained()
            tried.append((explained, X, F))
            if explained > FOUND:
                break
        explained, X, F = max(tried, key=lambda one: one[0])
        if explained > (FOUND if self.lost else PART):
            self.lost, self._missed, self._way = False, 0, 0.0
            self._found = self._taken(X, F, explained)
            return self._found
        return self._assumed(step)

    def _assumed(self, step: Array) -> MaterialMotion | None:
        """The motion where the material is not found: from where it was last, with the tool."""
        self._missed += 1
        if self._found is None or self.lost or self._missed > FRAMES:
            self.lost = True
            return None
        middle = self._X[:3, :3] @ self._area.mean(axis=1) + self._X[:3, 3]
        shift, turn = step[:3, :3] @ middle + step[:3, 3] - middle, so3_log(step[:3, :3])
        self._way += float(np.sqrt(shift @ shift)) + self.patch.size * float(np.sqrt(turn @ turn))
        self._X = step @ self._X
        off = ASSUMED[0] + ASSUMED[1] * self._way
        covariance = self._found.covariance + self._about_middle(off, self._X)
        return MaterialMotion(self._X, covariance, self._found.deformation, 0.0)

    def _descended(self, crop: Crop, X: Array, F: Array) -> Array:
        """The field after some steps of Gauss-Newton."""
        for i in range(STEPS):
            self._evaluate(crop, X, F, rescale=i == 0)
            H = self._prior + self._image.H + self._depth.H
            g = self._prior @ F.ravel() + self._image.g + self._depth.g
            change = solved(H, g).reshape(3, 6)
            F = F - change
            if np.square(change @ self._area_powers).sum(axis=0).mean() < DONE**2:
                break
        return F

    def _evaluate(self, crop: Crop, X: Array, F: Array, rescale: bool) -> None:
        """Residuals at a field (3, 6) beyond a motion (4, 4)."""
        model = self.model
        q = self._p + F.astype(np.float32) @ self._powers
        X_XM = model.X_XC @ X
        P = X_XM[:3, :3].astype(np.float32) @ q + X_XM[:3, 3:].astype(np.float32)
        pixels = model.camera.project32(P)
        pixels -= np.array(crop.origin, np.float32)[:, None]
        self._image.reweight(sample(crop.fine, pixels) - self._value, rescale)
        eye = inverse_pose(X_XM)[:3, 3:].astype(np.float32)
        z = sample(crop.depth, pixels)
        self._depth.reweight((ONE - z / P[2]) * (self._n * (q - eye)).sum(axis=0), rescale)

    def _explained(self) -> float:
        """Share of the grasp's image that the motion explains, 1 - sum w r^2 / sum w I_0^2."""
        value, w, r = self._value, self._image.w, self._image.r
        if r.size < FEW:
            return 0.0
        energy = float(value @ (w * value))
        share = 1.0 - float(r @ (w * r)) / energy if energy > 0.0 else 0.0
        return share * min(1.0, 4.0 * energy / max(float(value @ value), 1e-9))

    def _taken(self, X: Array, F: Array, explained: float) -> MaterialMotion:
        """What was found, as the rigid part and the remainder."""
        after = X[:3, :3] @ (self._area + F @ self._area_powers) + X[:3, 3:]
        X_CM = rigid_motion(self._area, after)
        beyond = X_CM[:3, :3].T @ (after - X_CM[:3, 3:]) - self._area
        size = float(np.sqrt(np.square(beyond).sum(axis=0).mean()))
        covariance = self._covariance(X) + self._unclear(size, X_CM)
        if explained < FOUND:
            covariance += self._about_middle(PATCHY, X_CM)
        self._X, self._F = X_CM, beyond @ self._field_of
        return MaterialMotion(X_CM, covariance, deformation(X_CM, self._area, after), explained)

    def _covariance(self, X: Array) -> Array:
        """(6, 6) of the rigid part; see rigid_fit/covariance.py."""
        H = self._prior + self._image.H + self._depth.H
        C = np.linalg.inv(H)
        C = C @ (OWN**2 * H + SCATTER**2 * (self._image.scatter() + self._depth.scatter())) @ C
        R = np.zeros((6, 6))
        R[:3, :3] = R[3:, 3:] = X[:3, :3]
        J = R @ self._rigid_of
        return np.asarray(J @ C @ J.T)

    def _unclear(self, size: float, X_CM: Array) -> Array:
        """(6, 6) of the rigid part of a patch that is not rigid: which of it touches is known to a pixel or two only.

        size: root mean square of what is not rigid [m].
        """
        return self._about_middle(UNCLEAR * size, X_CM)

    def _about_middle(self, off: float, X_CM: Array) -> Array:
        """(6, 6) of a motion of which all of the patch is known to a deviation [m]."""
        turn, way = (off / self.patch.size) ** 2, off**2
        about = np.eye(6)  # from the patch's middle to C
        about[3:, :3] = skew(X_CM[:3, :3] @ self._area.mean(axis=1) + X_CM[:3, 3])
        return np.asarray(about @ np.diag((turn, turn, turn, way, way, way)) @ about.T)
