# SPDX-License-Identifier: Apache-2.0
"""The membrane around the tool: imprint, skirt, bulge, and which material sits where.

Around an indenter the imprint decays exponentially (a recorded press decays by e in 8.5 mm on every side). The skirt is
the part of the membrane beside the tool that hangs free. Its outline follows the tool with a lag; the air's volume is
kept, so the rest of the dome bulges out.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from seed_core.spatial import Array, inverse_pose, make_pose, so3_exp, so3_log
from seed_sim.tactile.geometry import FAR, Image, Rays, dome_depth, tool_depth, turned
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.sheet import Sheet, share_at

_LATERAL = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))  # x and z of C
_STEPS = 3  # of the search for the material; inside the patch one is enough
_PEELED = 0.004  # [m]; gap over which material comes off the tool
_TOUCH = 5e-5  # [m]; membrane closer to the tool than this touches it
_REACH = (1, 2, 4)  # [coarse pixels] of the dilations that make the skirt
_FAR_REACH = (4, 4)  # [coarse pixels / 2] of those that make its outer part


class DeformedMembrane(NamedTuple):
    """Deformed membrane on the coarse grid.

    Attributes:
        depth, imprint: (h, w) [m].
        material: (2, h, w) x and z in C of the material seen, as it lay before contact [m].
    """

    depth: Image
    imprint: Image
    material: NDArray[np.float32]


class Membrane:
    """One bubble with one tool; stateless but for the grasp at X_CT = identity."""

    def __init__(self, rays: Rays, p: TactileParameters) -> None:
        self.rays, self.p = rays, p
        self.dome = dome_depth(rays, p, p.height)
        step = 0.001
        self._growth = (dome_depth(rays, p, p.height + step) - self.dome) / np.float32(step)
        points = rays.at(self.dome)
        across = np.linalg.norm(points[:, 1:, 1:] - points[:, :-1, :-1], axis=0)
        self._pixel = float(np.median(across)) / math.sqrt(2.0)  # [m] from one coarse pixel to the next
        self._area = _areas(points[0], points[2])
        h, w = self.dome.shape
        self._columns, self._rows = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
        self._in_image = self._axes_in_image() / self._pixel
        self.rest = DeformedMembrane(self.dome, np.zeros_like(self.dome), points[::2])
        _, _, raw, contact = self._imprint(np.eye(4))
        self.sheet = Sheet(rays.at(self.dome - raw)[::2, contact > 0.5].T, p)

    def press(self, X_CT: Array, X_stuck: Array, load: float = 0.0) -> DeformedMembrane:
        """With the tool at X_CT and material that has followed it to X_stuck; both (4, 4), identity at the grasp.

        load: share of the largest tangential load, from 0 (all of the patch sticks) to 1 (all of it slides).
        """
        tool, skirt, raw, contact = self._imprint(X_CT)
        free = np.float32(1.0) - cv2.GaussianBlur(contact, (0, 0), 1.0)
        free[contact > 0.5] = 0.0  # what touches well inside the patch neither lags nor lifts
        level = np.maximum(raw, np.float32(0.0))
        imprint = np.maximum(level, level + free * (self._lagging(skirt, X_stuck) - level))
        rounded = cv2.GaussianBlur(imprint, (0, 0), 1.3)  # rubber does not follow a sharp edge
        imprint = np.where(contact > 0.5, imprint, np.maximum(imprint, rounded))
        off = self._distance(contact)
        depth = np.minimum(self.dome + self._bulge(imprint, off) - imprint, tool)
        return DeformedMembrane(
            depth, imprint, self._material(depth, np.minimum(tool - depth, off), X_stuck, self.sheet.share(load))
        )

    def _imprint(self, X_CT: Array) -> tuple[Image, Image, Image, Image]:
        """Tool's depth, skirt, how far the tool passes the dome, and where it touches (0, 1); each (h, w)."""
        tool = tool_depth(self.rays, self.p.tool, X_CT)
        raw = self.dome - tool
        skirt = np.maximum(raw, np.float32(0.0))
        for reach in _REACH:
            skirt = _spread(skirt, reach, reach * self._pixel / self.p.decay)
        h, w = skirt.shape
        far = cv2.resize(skirt, (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        for reach in _FAR_REACH:
            far = _spread(far, reach, 2.0 * reach * self._pixel / self.p.decay)
        skirt = np.maximum(skirt, cv2.resize(far, (w, h), interpolation=cv2.INTER_LINEAR))
        contact = (raw > skirt - _TOUCH) & (raw > 2.0 * _TOUCH)
        skirt = np.maximum(cv2.GaussianBlur(skirt, (0, 0), 1.2), raw)
        return tool, skirt, raw, contact.astype(np.float32)

    def _distance(self, contact: Image) -> Image:
        """From each pixel to the nearest that touches, (h, w) [m]; far where nothing does."""
        if not contact.any():
            return np.full(contact.shape, FAR, np.float32)
        pixels = cv2.distanceTransform((contact < 0.5).astype(np.uint8), cv2.DIST_L2, 3)
        return np.asarray(pixels * np.float32(self._pixel), np.float32)

    def _bulge(self, imprint: Image, off: Image) -> Image:
        """Outward displacement (h, w) [m]: growth of the dome by the imprint's volume, held down near the contact.

        An imprint decays from contact relative to the grown dome, so growth comes in as 1 - exp(-distance / decay).
        """
        held = np.exp(off * np.float32(-1.0 / self.p.decay))
        whole = 2.0 / 3.0 * math.pi * self.p.rim_x * self.p.rim_z  # [m^2], volume per growth in height
        free = max(whole - float((self._growth * self._area * held).sum()), 0.2 * whole)
        height = self.p.bulge * float((imprint * self._area).sum()) / free
        return np.asarray(np.float32(height) * self._growth * (1.0 - held), np.float32)

    def _lagging(self, skirt: Image, X_stuck: Array) -> Image:
        """The skirt where softness leaves it: behind the tool, or dragged along by a round tool that spins."""
        points = self.rays.at(self.dome - skirt)
        in_image = self._in_image
        shape_motion = _motion(points, _without_spin(X_stuck) if self.p.tool.round else X_stuck, in_image)
        material_motion = _motion(points, X_stuck, in_image)
        shift = shape_motion - np.float32(1.0 - self.p.lag) * material_motion
        columns, rows = self._columns + shift[0], self._rows + shift[1]
        return np.asarray(cv2.remap(skirt, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))

    def _axes_in_image(self) -> Array:
        """(2, 3) directions in C along columns and rows of the image."""
        h, w = self.dome.shape
        d = self.rays.directions.astype(float)
        right, down = d[:, h // 2, -1] - d[:, h // 2, 0], d[:, -1, w // 2] - d[:, 0, w // 2]
        return np.stack((right / np.linalg.norm(right), down / np.linalg.norm(down)))

    def _material(self, depth: Image, gap: Image, X_stuck: Array, share: Image) -> NDArray[np.float32]:
        """Which material (2, h, w) is seen: m with m + share(m) motion = point, by fixed-point steps.

        Material that the tool has left behind by a gap peels off: neighbours that still stick carry it in part.
        """
        points = self.rays.at(depth)
        motion, lateral = _motion(points, X_stuck, _LATERAL), points[::2]
        motion *= 1.0 - np.float32(self.p.peel) * (1.0 - np.exp(gap * np.float32(-1.0 / _PEELED)))
        m = lateral - motion
        for _ in range(_STEPS):
            m = lateral - share_at(share, m) * motion
        return m


def _motion(points: NDArray[np.float32], X_CT: Array, axes: Array) -> NDArray[np.float32]:
    """How far tool-fixed points, now at (3, h, w) in C, have moved since the grasp (T = C), along axes (2, 3)."""
    X_TC = inverse_pose(X_CT)
    out = turned(axes @ (np.eye(3) - X_TC[:3, :3]), points)
    out -= (axes @ X_TC[:3, 3]).astype(np.float32)[:, None, None]
    return out


def _spread(field: Image, reach: int, fall: float) -> Image:
    """The larger of field (h, w) and the same spread by `reach` pixels and fallen by exp(-fall)."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return np.asarray(np.maximum(field, cv2.dilate(field, kernel) * np.float32(math.exp(-fall))), np.float32)


def _areas(x: Image, z: Image) -> Image:
    """Area [m^2] that each pixel covers, seen along y; x, z (h, w) [m]."""
    return np.asarray(np.abs(np.gradient(x, axis=1) * np.gradient(z, axis=0)), np.float32)


def _without_spin(X_CT: Array) -> Array:
    """X_CT without its turn about z_T, which does not move the surface of a round tool."""
    R = X_CT[:3, :3]
    twist = math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    return make_pose(R @ so3_exp((0.0, 0.0, -twist)), X_CT[:3, 3])


def followed(X_CT: Array, slip: float) -> Array:
    """Pose that the material reaches when it follows the motion since the grasp by 1 - slip."""
    if slip == 0.0:
        return X_CT
    return make_pose(so3_exp((1.0 - slip) * so3_log(X_CT[:3, :3])), (1.0 - slip) * X_CT[:3, 3])
