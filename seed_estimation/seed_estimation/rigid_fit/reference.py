# SPDX-License-Identifier: Apache-2.0
"""One finger at the moment of grasp, prepared for alignment: points, normals, grey values and Jacobians.

The tool is followed against this one reference, which never changes: nothing drifts. A point p of the membrane in
contact moves with the tool, X_CT p. Both residuals are linearised once, in the tool's frame at the grasp (inverse
composition: X_CT <- X_CT exp(xi)^-1, xi = [rotation, translation]), so a frame costs sampling and small products only:

    image   r = I_t(pi(X_XC X_CT p)) - I_0(u)           J = grad I_0 . d pi . [-[p]x, 1]
    depth   r = n . (p - q), q the measured point on the ray through X_CT p, taken back to the tool; J = [p x n, n]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.membrane.material import around
from seed_core.spatial import Array, inverse_pose
from seed_estimation.contact.membrane import Membrane
from seed_estimation.contact.patch import PatchFinder
from seed_estimation.contact.surface import fitted_parabolas, lies_on_tool, surface
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.checks import EstimatorError
from seed_estimation.images.normalise import coarse, normalised
from seed_estimation.images.tactile_images import Array32, Bools, Image, Mask
from seed_estimation.material.patch import touching
from seed_estimation.parameters import EstimatorParameters

Indices = NDArray[np.intp]
CELL = 16  # [px] side of the pieces of a patch whose errors count as independent: two markers and more
TELLS = 0.3  # [1] of what seems to lie on the tool: where less touches by its curvature, that tells nothing
SURFACE_BLUR = 2.5  # [px] over which the depth image is smoothed


@dataclass(frozen=True, eq=False)
class ImagePoints:
    """Infrared pixels followed at one level: values (N,) and Jacobian (6, N) in two parts.

    Sideways motion, across the camera's axis, is what the membrane may fail to follow; the rest it cannot but follow.
    """

    p: Array32  # (3, N) in the tool's frame [m]
    n: Array32  # (3, N) unit normals, in the tool's frame
    value: Array32
    J_along: Array32
    J_rest: Array32
    cells: Indices  # (N,) number of the piece of the patch that it lies in, rising

    def chosen(self, index: Indices) -> ImagePoints:
        """Those of the given indices, rising."""
        if index.size == self.value.size:
            return self
        p, n, J_along, J_rest = (a.take(index, axis=1) for a in (self.p, self.n, self.J_along, self.J_rest))
        return ImagePoints(p, n, self.value[index], J_along, J_rest, self.cells[index])

    def jacobian(self, slip: float) -> Array32:
        """(6, N) when the membrane follows a share 1 - slip of the sideways motion."""
        return self.J_along * np.float32(1.0 - slip) + self.J_rest


@dataclass(frozen=True, eq=False)
class Material:
    """A piece of the membrane whose material is followed: fine infrared points, and pixels (3, K) of it, evenly [m]."""

    points: ImagePoints
    area: Array32


@dataclass(frozen=True, eq=False)
class FingerModel:
    """One finger at the moment of grasp; C and T coincide."""

    finger: str
    camera: PinholeCamera
    X_XC: Array  # pose of C in the optical frame
    levels: tuple[ImagePoints, ImagePoints]  # coarse, fine
    p: Array32  # (3, M) depth pixels in the tool's frame [m]
    n: Array32  # (3, M) unit normals towards the camera
    n_p: Array32  # (M,) n . p
    J: Array32  # (6, M) of the depth residual
    cells: Indices  # (M,) as of the image's points
    rest: Array32  # (H, W, 3) depth of the membrane at rest [m], its slope to the right and downwards [1]
    decay: float  # [m]
    picture: Image  # (H, W) coarse infrared of the patch, 0 beside it
    patch: Material  # all of the membrane that touches the tool
    around: Material | None  # the band of the free membrane around that, where it is seen
    seen: Array32  # (3, L) some of all that is followed: what an image has to show [m]

    def without_image(self) -> FingerModel:
        """The same of which depth alone is followed."""
        coarse, fine = (level.chosen(np.zeros(0, np.intp)) for level in self.levels)
        return replace(self, levels=(coarse, fine))

    def without_depth(self) -> FingerModel:
        """The same of which the infrared image alone is followed."""
        return replace(self, p=self.p[:, :0], n=self.n[:, :0], n_p=self.n_p[:0], J=self.J[:, :0], cells=self.cells[:0])

    @cached_property
    def surfaces(self) -> tuple[tuple[Array32, Array32], tuple[Array32, Array32]]:
        """Points and normals (3, N + M) of each level's image and of depth, in that order."""
        coarse, fine = (
            (np.concatenate((i.p, self.p), axis=1), np.concatenate((i.n, self.n), axis=1)) for i in self.levels
        )
        return coarse, fine

    @cached_property
    def outward(self) -> Array:
        """(3,) unit vector along y of C, on which the fingers move, from the tool to this finger's camera."""
        return np.array((0.0, float(np.sign(inverse_pose(self.X_XC)[1, 3])), 0.0))

    def pixels(self, X_CT: Array, p: Array32) -> Array32:
        """Where points (3, N) of the tool appear in the image (2, N) [px]."""
        X = self.X_XC @ X_CT
        return self.camera.project32((X[:3, :3] @ p + X[:3, 3:]).astype(np.float32))


def finger_model(finder: PatchFinder, depth: Image, ir: Image, mask: Mask, p: EstimatorParameters) -> FingerModel:
    """The model from the images of the grasp: means of depth [m] and infrared [counts], and contact, (H, W) each.

    Raises:
        EstimatorError: the patch is too small to be followed.
    """
    membrane, core = finder.membrane, finder.core(depth, mask, p)
    # beyond the patch's edge the surface is another one: it must not leak in
    valid = np.isfinite(depth) & (depth > p.near) & (depth < p.far) & (core > 0)
    points, normals = _surface(membrane.camera, depth, valid)
    known = np.isfinite(normals).all(axis=2) & np.isfinite(points).all(axis=2)
    on_tool = lies_on_tool(membrane.rest.reshape(-1, 3), points[..., 2].ravel(), normals.reshape(-1, 3).T, p.decay)
    good = _eroded(core, p.erosion) & known & on_tool.reshape(core.shape)
    touches = touching(membrane, depth, mask)
    if np.count_nonzero(good & touches) >= TELLS * np.count_nonzero(good):
        good &= touches  # an imprint that falls more slowly than `decay`, at even pressure: a skirt passes for tool
    if np.count_nonzero(good) < p.least_area // 3:
        raise EstimatorError(f"{membrane.finger} bubble: the patch is too small to follow; close the gripper further")
    blurred, picture = coarse(ir), normalised(ir)
    levels = (
        _image_points(blurred, good, points, normals, membrane, p.image_points // 2),
        _image_points(picture, good, points, normals, membrane, p.image_points),
    )
    patch, band = _materials(membrane, depth, picture, good, touches, p)
    v, u, cells = _sorted_by_cell(*_evenly(good, p.depth_points))
    P, n = _in_hand(points[v, u], normals[v, u], membrane.X_CX)
    rows = _rows(P)
    return FingerModel(
        finger=membrane.finger,
        camera=membrane.camera,
        X_XC=inverse_pose(membrane.X_CX),
        levels=levels,
        p=rows,
        n=_rows(n),
        n_p=(n * P).sum(axis=1),
        J=_motion_jacobian(P, n),
        cells=cells,
        rest=membrane.rest,
        decay=p.decay,
        picture=np.where(good, blurred, np.float32(0.0)),
        patch=patch,
        around=band,
        seen=np.concatenate([a[:, ::7] for a in (rows, patch.area, *([band.area] if band else []))], axis=1),
    )


def _surface(camera: PinholeCamera, depth: Image, valid: Bools) -> tuple[Array32, Array32]:
    """Points of the smooth surface that is seen, and normals of a blurred one, (H, W, 3); NaN where invalid.

    A blurred surface lies beside the one that is seen where that is curved: what has not moved would seem to go there.
    """
    _, normals = surface(camera, depth, valid, SURFACE_BLUR)
    return camera.rays32 * fitted_parabolas(depth, valid, SURFACE_BLUR)[..., None], normals


def _materials(
    membrane: Membrane, depth: Image, picture: Image, good: Bools, touches: Bools, p: EstimatorParameters
) -> tuple[Material, Material | None]:
    """All the membrane that touches (`good` where that is not to be told), and the band around it where it is seen."""
    points, normals = _surface(membrane.camera, depth, np.isfinite(depth) & (membrane.area > 0))
    known = np.isfinite(normals).all(axis=2) & np.isfinite(points).all(axis=2)
    touches = touches & known
    if np.count_nonzero(touches) < p.least_area // 3:
        touches = good

    def in_hand(v: Indices, u: Indices) -> Array32:
        return _rows(_in_hand(points[v, u], normals[v, u], membrane.X_CX)[0])

    def material(area: Bools) -> Material:
        image = _image_points(picture, area, points, normals, membrane, p.image_points)
        return Material(image, in_hand(*_evenly(area, p.depth_points)))

    band = np.zeros(known.shape, bool)
    band[known] = around(in_hand(*np.nonzero(known)), in_hand(*np.nonzero(touches)))
    return material(touches), material(band) if np.count_nonzero(band) >= p.least_area else None


def _evenly(area: Bools, wanted: int) -> tuple[Indices, Indices]:
    """Rows and columns of about so many pixels of an area (H, W), on an even lattice.

    Every n-th of them, row by row, would stand in slanted lines, other ones for each pixel more or less.
    """
    step = max(float(np.sqrt(np.count_nonzero(area) / wanted)), 1.0)
    rows, columns = (np.diff(np.floor(np.arange(n + 1) / step)) > 0.0 for n in area.shape)
    v, u = np.nonzero(area & rows[:, None] & columns)
    return v, u


def _eroded(mask: Mask, width: int) -> Bools:
    """The mask without a border of the given width [px]; less when nothing much would be left."""
    for w in range(width, 0, -1):
        side = 2 * w + 1
        inner = cv2.erode(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), borderValue=0)
        if np.count_nonzero(inner) > 0.3 * np.count_nonzero(mask):
            return np.asarray(inner > 0)
    return np.asarray(mask > 0)


def _image_points(
    image: Image, good: Bools, points: Array32, normals: Array32, membrane: Membrane, wanted: int
) -> ImagePoints:
    """The pixels of strongest gradient: they tell the motion best."""
    gx = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1.0 / 32.0)
    gy = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1.0 / 32.0)
    strength = np.where(good, gx * gx + gy * gy, -1.0)
    count = min(wanted, int(np.count_nonzero(good)))
    best = np.argpartition(strength.ravel(), -count)[-count:]
    v, u, cells = _sorted_by_cell(*np.unravel_index(best, image.shape))
    P_X, n_X = points[v, u], normals[v, u]
    P, n = _in_hand(P_X, n_X, membrane.X_CX)
    slope = _gradient_in_space(membrane.camera, P_X, np.stack((gx[v, u], gy[v, u]), axis=1))
    along = slope - slope[:, 2:] / n_X[:, 2:] * n_X  # what sideways motion changes while the point stays on the surface
    R_XC = inverse_pose(membrane.X_CX)[:3, :3].astype(np.float32)
    along, slope = along @ R_XC, slope @ R_XC
    return ImagePoints(
        _rows(P), _rows(n), image[v, u], _motion_jacobian(P, along), _motion_jacobian(P, slope - along), cells
    )


def _gradient_in_space(camera: PinholeCamera, P_X: Array32, gradient: Array32) -> Array32:
    """d I / d P (N, 3) [1/m] from the image's gradient (N, 2) [1/px], at points P_X (N, 3) of the optical frame."""
    step = 1e-5  # [m]
    out = np.empty_like(P_X)
    for axis, d in enumerate(step * np.eye(3)):
        pixels = (camera.project(P_X.astype(float) + d) - camera.project(P_X.astype(float) - d)) / (2.0 * step)
        out[:, axis] = (gradient * pixels).sum(axis=1)
    return out


def _motion_jacobian(P: Array32, slope: Array32) -> Array32:
    """(6, N) change of value with [rotation, translation] of points P (N, 3), from d value / d P (N, 3)."""
    return _rows(np.hstack((np.cross(P, slope), slope)))


def _sorted_by_cell(v: Indices, u: Indices) -> tuple[Indices, Indices, Indices]:
    """Pixels sorted by the piece of the patch in which they lie, and that piece's number."""
    cells = (v // CELL) * 256 + u // CELL
    order = np.argsort(cells, kind="stable")
    return v[order], u[order], cells[order]


def _in_hand(points: Array32, normals: Array32, X_CX: Array) -> tuple[Array32, Array32]:
    R = X_CX[:3, :3].astype(np.float32)
    return points @ R.T + X_CX[:3, 3].astype(np.float32), normals @ R.T


def _rows(values: Array32) -> Array32:
    """(N, 3) as contiguous (3, N): one pass per coordinate is what a frame's arithmetic costs."""
    return np.ascontiguousarray(values.T, dtype=np.float32)
