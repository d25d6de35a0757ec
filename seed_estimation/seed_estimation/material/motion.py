# SPDX-License-Identifier: Apache-2.0
"""How the material of one finger's membrane has moved since the grasp: the membrane is the spring, the tool is not.

Points p of a piece of the membrane at the grasp, its patch or the band around that, are followed by their dots. They
lie on the membrane that depth shows, whether the tool touches them or not, and whether they stick to it or not:

    q = X (p + F powers(p)),    X a rigid motion, F (3, K) a smooth field in powers 1, u, v, u^2, u v, v^2 ...

Robust Gauss-Newton finds F from the fine infrared image of the grasp (r = I_t(q) - I_0(p)) and from depth (distance of
q along its normal from the membrane) with Jacobians that are made once, for p. X is where the tool's last motion would
have brought the material; after a frame it becomes the rigid part of what was found, the least sum of squares over the
patch, so F stays the small remainder.

Where the dots of a finger are not found for a moment, its material is taken to move as the tool does, and is known the
worse the longer that lasts and the further the tool goes.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from seed_core.membrane.material import Patch, of_field, patch_of, rigid_motion
from seed_core.spatial import Array, both, inverse_pose, length, make_pose, skew, so3_exp, so3_log
from seed_estimation.images.sampling import Crop, sample
from seed_estimation.images.tactile_images import Array32
from seed_estimation.rigid_fit.reference import FingerModel, Material
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

STRAIN = 1e-3, 3e-3  # [m] deviation of what bends patch and band, before anything is seen
STEPS = 3  # at most, of one frame
DONE = 2e-5  # [m] of the patch's mean motion in one step: the next would be a fraction of it
FOUND = 0.5  # [1] of the image that the motion explains where it is found well
PART = 0.25  # [1] that it must explain: friction lets a patch go in pieces, which no smooth field follows
PATCHY = 0.0005  # [m] by which the patch's motion is uncertain then
OWN = 0.5  # [1] deviations of the fit's own information
# [1] share of what is not rigid by which the rigid part is uncertain: of a patch, whose end is known to a pixel or two,
# and of the band around it, where the deformations that are told beside make up for most of that
UNCLEAR = 0.2, 0.06
SCATTER = 0.65  # [1] deviations of how far pieces of the patch contradict each other
ASSUMED = 0.0003, 0.5  # [m] and share of the tool's way since, by which material that is not found may be elsewhere
FRAMES = 8  # for which it is assumed at most
# [1] share of the tool's turn, and of its shift along x, y, z of C, by which the band about its patch goes along
BAND_TURNS, BAND_GOES = 0.4, np.array((0.75, 0.35, 0.75))
ONE = np.float32(1.0)


class MaterialMotion(NamedTuple):
    """Motion of the material since the grasp.

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


Motions = dict[str, MaterialMotion]  # by finger


class MaterialTracker:
    """Follows a piece of one finger's membrane from frame to frame, in one grasp: its patch, or the band around that.

    The band hangs free, between a patch that goes with the tool and a rim that does not, and bends the more.
    """

    def __init__(self, model: FingerModel, material: Material) -> None:
        points = material.points
        self._degree = 2 if material is model.patch else 3
        self.model, self._p, self._n = model, points.p, points.n
        self._value = points.value
        self.patch: Patch = patch_of(material.area)
        self._powers = self.patch.powers(points.p, self._degree).astype(np.float32)  # (K, N)
        self._count = 3 * len(self._powers)  # unknowns
        slope = (points.J_along + points.J_rest)[3:]  # of the image in space
        self._image = Residuals(self._spread(slope), points.cells, SHARE_IMAGE, IMAGE_FLOOR)
        self._depth = Residuals(self._spread(points.n), points.cells, SHARE_DEPTH, DEPTH_FLOOR, DEPTH_COMMON)
        self._area = material.area.astype(float)  # (3, M)
        self._area_powers = self.patch.powers(self._area, self._degree)
        self._field_of = np.linalg.pinv(self._area_powers)  # (M, K)
        self._shape_of = np.linalg.pinv(self.patch.powers(self._area))  # (M, 6)
        self._rigid_of = self._rigid_part()
        bends = np.full(len(self._powers), STRAIN[self._degree - 2] ** -2.0)
        bends[0] = 0.0
        self._prior = np.diag(np.tile(bends, 3))
        self._X, self._F = np.eye(4), np.zeros((3, len(self._powers)))
        self._found: MaterialMotion | None = None  # last
        self._missed, self._way = 0, 0.0  # frames since, and how far the tool has gone in them [m]
        self.lost = False

    def _spread(self, direction: Array32) -> Array32:
        """(3 K, N) change of a value with F from its change with a point's place (3, N)."""
        J = direction[:, None, :] * self._powers[None]
        return np.ascontiguousarray(J.reshape(self._count, -1), np.float32)

    def _rigid_part(self) -> Array:
        """(6, 3 K) [rotation vector, translation] that fits a small field best over the patch."""
        p, powers = self._area, self._area_powers
        motion = np.concatenate([np.hstack((-skew(x), np.eye(3))) for x in p.T])  # (3 M, 6)
        field = np.einsum("kl,am->mkla", np.eye(3), powers).reshape(-1, self._count)  # (3 M, 3 K)
        return np.asarray(np.linalg.lstsq(motion, field, rcond=None)[0])

    def follow(self, crop: Crop, step: Array, X_CT: Array) -> MaterialMotion | None:
        """The motion in a frame, or None where the material has not been found for some frames.

        step: (4, 4) how the tool has moved in C since the frame before; X_CT: where it is now.
        """
        step = self._share(step)
        starts = [(self._share(X_CT), np.zeros_like(self._F))]
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

    def _share(self, X: Array) -> Array:
        """What a motion X (4, 4) of the tool is likely to be of this material."""
        if self._degree == 2:
            return X
        middle = self._area.mean(axis=1)
        turn = so3_exp(BAND_TURNS * so3_log(X[:3, :3]))
        shift = BAND_GOES * (X[:3, :3] @ middle + X[:3, 3] - middle)
        return make_pose(turn, middle + shift - turn @ middle)

    def _assumed(self, step: Array) -> MaterialMotion | None:
        """The motion where the material is not found: from where it was last, as it is likely to go with the tool."""
        self._missed += 1
        if self._found is None or self.lost or self._missed > FRAMES:
            self.lost = True
            return None
        middle = self._X[:3, :3] @ self._area.mean(axis=1) + self._X[:3, 3]
        shift, turn = step[:3, :3] @ middle + step[:3, 3] - middle, so3_log(step[:3, :3])
        self._way += length(shift) + self.patch.size * length(turn)
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
            change = solved(H, g).reshape(F.shape)
            F = F - change
            if np.square(change @ self._area_powers).sum(axis=0).mean() < DONE**2:
                break
        return F

    def _evaluate(self, crop: Crop, X: Array, F: Array, rescale: bool) -> None:
        """Residuals at a field (3, K) beyond a motion (4, 4)."""
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
        deformation = of_field((X_CM[:3, :3] @ beyond)[[0, 2]] @ self._shape_of)
        return MaterialMotion(X_CM, covariance, deformation, explained)

    def _covariance(self, X: Array) -> Array:
        """(6, 6) of the rigid part; see rigid_fit/covariance.py."""
        H = self._prior + self._image.H + self._depth.H
        C = np.linalg.inv(H)
        C = C @ (OWN**2 * H + SCATTER**2 * (self._image.scatter() + self._depth.scatter())) @ C
        J = both(X[:3, :3]) @ self._rigid_of
        return np.asarray(J @ C @ J.T)

    def _unclear(self, size: float, X_CM: Array) -> Array:
        """(6, 6) of the rigid part of a patch that is not rigid: which of it touches is known to a pixel or two only.

        size: root mean square of what is not rigid [m].
        """
        return self._about_middle(UNCLEAR[self._degree - 2] * size, X_CM)

    def _about_middle(self, off: float, X_CM: Array) -> Array:
        """(6, 6) of a motion of which all of the patch is known to a deviation [m]."""
        return about_middle(self._area.mean(axis=1), self.patch.size, off, X_CM[:3, :3])


def about_middle(middle: Array, size: float, off: float, R: Array) -> Array:
    """(6, 6) of a motion's (rotation vector, shift of the origin) where a patch is known to a deviation `off` [m].

    Args:
        middle: (3,) [m] of the patch before the motion, whose shift is known to `off`, and its turn to `off / size`.
        size: [m] of the patch.
        R: (3, 3) of the motion.
    """
    turn, way = (off / size) ** 2, off**2
    about = np.eye(6)  # a turn about the moved middle shifts the origin
    about[3:, :3] = skew(R @ middle)
    return np.asarray(about @ np.diag((turn, turn, turn, way, way, way)) @ about.T)


class Followed:
    """Pieces of the membranes of several fingers, followed together."""

    def __init__(self, pieces: Sequence[MaterialTracker]) -> None:
        self._pieces = pieces
        self._seen = np.eye(4)  # X_CT when they were looked at last

    def follow(self, crops: Mapping[str, Crop], X_CT: Array) -> Motions:
        """How they have moved where the tool is at X_CT (4, 4), by finger whose piece is found."""
        step, self._seen = X_CT @ inverse_pose(self._seen), X_CT
        found = {m.model.finger: m.follow(crops[m.model.finger], step, X_CT) for m in self._pieces}
        return {finger: motion for finger, motion in found.items() if motion is not None}
