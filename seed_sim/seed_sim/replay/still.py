# SPDX-License-Identifier: Apache-2.0
"""A still picture of meshes, drawn by NumPy: no display, no graphics card, the same pixels on every machine.

One light with shadows from the upper left, and the sky from all around.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from seed_core.meshes import Mesh
from seed_core.meshes.shapes import Colour
from seed_core.spatial import Array, inverse_pose, make_pose

Pixels = NDArray[Any]
_FINE = 2  # pixels drawn for each pixel of the picture, along both axes
_CREASE = 0.75  # cosine between a face and its corner's mean normal below which the edge stays sharp
_NEAR = 0.02  # [m]
_SHADOW = 900  # pixels along each side of the light's picture
_LIGHT, _SKY = 0.55, 0.62  # how much comes from the light, and from the sky


class Body(NamedTuple):
    """A mesh in the world with its colour; opacity below 1 shows what is behind it."""

    mesh: Mesh
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks from `eye` to `target`, both (3,) [m], z up; field of view [rad] over the height."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    view: float = 0.6
    size: tuple[int, int] = (1200, 700)  # [pixels] width and height
    parallel: float = 0.0  # [m] that the height shows without perspective; 0: with it

    @property
    def X_WF(self) -> Array:
        """(4, 4) optical frame: z forward, x right, y down."""
        forward = np.array(self.target) - self.eye
        forward = forward / np.linalg.norm(forward)
        up = np.array((0.0, 0.0, 1.0)) if abs(forward[2]) < 0.999 else np.array((0.0, 1.0, 0.0))
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return make_pose(np.column_stack([right, np.cross(forward, right), forward]), self.eye)

    def project(self, points: ArrayLike) -> tuple[Array, Array]:
        """Pixels (n, 2) of points (n, 3) [m], and their depth (n,) [m]."""
        X_FW = inverse_pose(self.X_WF)
        p = np.atleast_2d(np.asarray(points, float)) @ X_FW[:3, :3].T + X_FW[:3, 3]
        w, h = self.size
        if self.parallel:
            return p[:, :2] * (h / self.parallel) + (0.5 * w, 0.5 * h), p[:, 2]
        f = 0.5 * h / np.tan(0.5 * self.view)
        return f * p[:, :2] / np.maximum(p[:, 2:], 1e-6) + (0.5 * w, 0.5 * h), p[:, 2]


class _Canvas:
    """What the camera sees at each pixel: depth, normal and colour of the nearest surface."""

    def __init__(self, camera: Camera) -> None:
        self.camera, (w, h) = camera, camera.size
        self.depth = np.full((h, w), np.inf, np.float32)
        self.normal = np.zeros((h, w, 3), np.float32)
        self.colour = np.zeros((h, w, 3), np.float32)

    def draw(self, body: Body) -> None:
        """All faces of the body that look this way."""
        mesh = body.mesh
        pixels, depth = self.camera.project(mesh.vertices)
        corners, away, normals = pixels[mesh.faces], depth[mesh.faces], _corner_normals(mesh)
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        h, w = self.depth.shape
        low, high = np.floor(corners.min(axis=1)).astype(int), np.ceil(corners.max(axis=1)).astype(int)
        seen = (area < -1e-9) & (away.min(axis=1) > _NEAR)
        seen &= (high >= 0).all(axis=1) & (low[:, 0] < w) & (low[:, 1] < h)
        colour = np.array(body.colour, np.float32) / 255.0
        for i in np.flatnonzero(seen):
            x0, y0 = np.maximum(low[i], 0)
            x1, y1 = min(high[i, 0] + 1, w), min(high[i, 1] + 1, h)
            x, y = np.arange(x0, x1) + 0.5, (np.arange(y0, y1) + 0.5)[:, None]
            s = ((x - a[i, 0]) * (c[i, 1] - a[i, 1]) - (y - a[i, 1]) * (c[i, 0] - a[i, 0])) / area[i]
            t = ((b[i, 0] - a[i, 0]) * (y - a[i, 1]) - (b[i, 1] - a[i, 1]) * (x - a[i, 0])) / area[i]
            inside = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0)
            if not inside.any():
                continue
            if self.camera.parallel:
                z = (1.0 - s - t) * away[i, 0] + s * away[i, 1] + t * away[i, 2]
            else:
                z = 1.0 / ((1.0 - s - t) / away[i, 0] + s / away[i, 1] + t / away[i, 2])
            at = self.depth[y0:y1, x0:x1]
            nearer = inside & (z < at)
            at[nearer] = z[nearer]
            s, t = s[nearer][:, None], t[nearer][:, None]
            n = normals[i]
            self.normal[y0:y1, x0:x1][nearer] = (1.0 - s - t) * n[0] + s * n[1] + t * n[2]
            self.colour[y0:y1, x0:x1][nearer] = colour

    def points(self, seen: Pixels) -> Array:
        """(n, 3) [m] in the world of what is seen at pixels given as a mask (h, w)."""
        h, w = self.depth.shape
        rows, columns = np.nonzero(seen)
        z = self.depth[seen].astype(float)
        x, y = columns + 0.5 - 0.5 * w, rows + 0.5 - 0.5 * h
        parallel = self.camera.parallel
        scale = parallel / h if parallel else z * (2.0 * np.tan(0.5 * self.camera.view) / h)
        X = self.camera.X_WF
        return np.asarray(np.column_stack([x * scale, y * scale, z]) @ X[:3, :3].T + X[:3, 3])


def picture(bodies: Iterable[Body], camera: Camera, sky: Colour = (255, 255, 255)) -> NDArray[np.uint8]:
    """(h, w, 3) red, green, blue of the bodies as the camera sees them."""
    fine = Camera(
        camera.eye, camera.target, camera.view, (_FINE * camera.size[0], _FINE * camera.size[1]), camera.parallel
    )
    all_bodies = list(bodies)
    solid = [b for b in all_bodies if b.opacity >= 1.0]
    clear = [b for b in all_bodies if b.opacity < 1.0]
    canvas = _Canvas(fine)
    for body in solid:
        canvas.draw(body)
    light = _Light(camera, solid)
    out = _shaded(canvas, light, sky)
    for body in sorted(clear, key=lambda b: -float(camera.project(b.mesh.vertices)[1].mean())):
        layer = _Canvas(fine)
        layer.depth[:] = canvas.depth
        layer.draw(body)
        new = layer.normal.any(axis=-1)
        if new.any():
            mixed = body.opacity * _shaded(layer, light, sky)[new] + (1.0 - body.opacity) * out[new]
            out[new] = mixed
    small = cv2.resize(out.astype(np.float32), camera.size, interpolation=cv2.INTER_AREA)
    return np.asarray(np.clip(255.0 * small, 0.0, 255.0).round(), np.uint8)


class _Light:
    """One light far away, with the shadows that it throws; it comes from behind the viewer's left shoulder."""

    def __init__(self, camera: Camera, bodies: list[Body]) -> None:
        X = camera.X_WF
        to_light = -0.45 * X[:3, 0] - 0.75 * X[:3, 2] + np.array((0.0, 0.0, 1.0))
        self.direction = to_light / np.linalg.norm(to_light)
        distance = float(np.linalg.norm(np.array(camera.target) - camera.eye))
        reach = 1.6 * (camera.parallel or 2.0 * distance * float(np.tan(0.5 * camera.view)))
        x, y, z = np.array(camera.target) + 2.0 * max(distance, reach) * self.direction
        self._camera = Camera((x, y, z), camera.target, size=(_SHADOW, _SHADOW), parallel=reach)
        self._bias = 3.0 * reach / _SHADOW
        seen = _Canvas(self._camera)
        for body in bodies:
            seen.draw(body)
        self._depth = seen.depth

    def share(self, points: Array) -> Array:
        """(n,) how much of the light reaches points (n, 3)."""
        pixels, depth = self._camera.project(points.reshape(-1, 3))
        u, v = pixels.T
        lit = np.zeros(len(depth), np.float32)
        beyond = (np.minimum(u, v) < 1.0) | (np.maximum(u, v) > _SHADOW - 2.0)
        for a, b in ((-1.0, -0.5), (0.5, -1.0), (1.0, 0.5), (-0.5, 1.0)):
            i = np.clip((v + b).astype(np.int32), 0, _SHADOW - 1) * _SHADOW
            i += np.clip((u + a).astype(np.int32), 0, _SHADOW - 1)
            lit += (self._depth.ravel()[i] > depth - self._bias) | beyond
        return np.asarray(lit.reshape(points.shape[:-1]) / 4.0)


def _shaded(canvas: _Canvas, light: _Light, sky: Colour) -> Array:
    """(h, w, 3) colours from 0 to 1."""
    seen = np.isfinite(canvas.depth) & canvas.normal.any(axis=-1)
    out = np.empty_like(canvas.colour)
    out[:] = np.array(sky, np.float32) / 255.0
    n = canvas.normal[seen]
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-9)
    facing = np.maximum(n @ light.direction.astype(np.float32), 0.0)
    shine = light.share(canvas.points(seen))
    half = light.direction - canvas.camera.X_WF[:3, 2]
    gloss = np.maximum(n @ (half / np.linalg.norm(half)).astype(np.float32), 0.0) ** 40
    amount = _SKY * (0.75 + 0.25 * n[:, 2]) + _LIGHT * facing * shine
    out[seen] = canvas.colour[seen] * amount[:, None] + (0.14 * gloss * shine)[:, None]
    return np.asarray(out)


def _corner_normals(mesh: Mesh) -> NDArray[np.float32]:
    """(m, 3, 3) normals at the corners of the faces: smooth over round bodies, sharp at edges."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    face = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-15)
    mean = np.zeros_like(mesh.vertices)
    for i in range(3):
        np.add.at(mean, mesh.faces[:, i], area)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-15)
    corner = mean[mesh.faces]
    smooth = (corner * face[:, None]).sum(axis=2, keepdims=True) > _CREASE
    return np.where(smooth, corner, face[:, None]).astype(np.float32)
