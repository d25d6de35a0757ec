# SPDX-License-Identifier: Apache-2.0
"""A bubble as a closed mesh in C: at rest, as a depth image shows it, as a tool's pose would press it, or as a sheet.

bubble = Bubble("left")
mesh = bubble.mesh                                      # at rest
vertices = bubble.seen(depth, (fx, fy, cx, cy), hand.X_CL)  # the same faces, deformed; 0.2 ms
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_core.meshes.shapes import Faces, loft
from seed_core.spatial import Array, inverse_pose

RIM_X, RIM_Z, HEIGHT = 0.057, 0.040, 0.030  # [m] semi-axes of the rim along x_C and z_C; of the dome over the rim
RIM = 0.0355  # [m] from C to the plane of each rim, the gripper closed on a handle of 12 mm radius
RADIUS = 0.012  # [m] of that handle
_DECAY = 0.0085  # [m] over which an imprint decays by e beside the tool
_BULGE = 0.6  # share of an imprint's volume that comes out beside it
_NEAR, _FAR = 0.4, 1.6  # a depth of less or more than these shares of the dome's at rest is none
SIDES = {"left": 1.0, "right": -1.0}  # which way along y_C each lies; the domes point at each other


class Bubble:
    """One bubble. Its vertices are n points of the dome, ring by ring from the rim in, then the back and the apex.

    Args:
        finger: 'left' or 'right'.
        rim: [m] from C to the plane of the rim.
        rings, sectors: of the dome's points; fewer make a smaller file.

    Attributes:
        mesh: at rest, closed by a flat back in the plane of the rim. Inside, behind the dome, sits the camera; outside,
            towards C, the tool.
    """

    def __init__(self, finger: str, rim: float = RIM, rings: int = 16, sectors: int = 48) -> None:
        self.side, self._sectors = SIDES[finger], sectors
        r = np.linspace(0.0, 1.0, rings)[:, None] ** 0.9
        r[0] = 0.02
        angle = 2.0 * np.pi * np.arange(sectors) / sectors * self.side
        x, z = RIM_X * r * np.cos(angle), RIM_Z * r * np.sin(angle)
        y = self.side * (rim - HEIGHT * np.sqrt(np.maximum(1.0 - r**2, 0.0)) + 0.0 * angle)
        self.mesh = loft(np.stack([x, y, z], axis=-1)[::-1])
        n = rings * sectors
        self._n, self._rim = n, np.arange(len(self.mesh.vertices)) < sectors
        flat = self.mesh.vertices[:n, ::2]
        apart = np.linalg.norm(flat[:, None] - flat[None], axis=2)
        self._fall = np.exp(apart.astype(np.float32) / np.float32(-_DECAY))
        share = np.hypot(flat[:, 0] / RIM_X, flat[:, 1] / RIM_Z)
        self._free = np.sqrt(np.maximum(1.0 - share**2, 0.0))
        self._free[self._rim[:n]] = 0.0
        self._lookup: tuple[Any, ...] | None = None

    def seen(self, depth: NDArray[Any], intrinsics: tuple[float, float, float, float], X_CF: Array) -> Array:
        """Vertices as a camera inside sees the membrane; where it sees none they stay at rest.

        Args:
            depth: (h, w) [m]; 0 or not a number where there is none.
            intrinsics: fx, fy, cx, cy [pixels].
            X_CF: (4, 4) optical frame of the camera in C.
        """
        key = (depth.shape, intrinsics, X_CF.tobytes())
        if self._lookup is None or self._lookup[0] != key:
            self._lookup = (key, *self._rays(depth.shape, intrinsics, X_CF))
        _, near, rays, at_rest, index = self._lookup
        found = np.asarray(depth, np.float32).ravel()[index]  # (n, 9): a pixel with its neighbours
        found = np.where((found > _NEAR * at_rest[:, None]) & (found < _FAR * at_rest[:, None]), found, np.nan)
        count = np.isfinite(found).sum(axis=1)
        found.sort(axis=1)  # nan last: the median of the others
        middle = found[np.arange(len(found)), np.maximum(count - 1, 0) // 2]
        measured = np.where(count >= 3, middle, at_rest)
        rest = self.mesh.vertices[: self._n]
        fixed = self._rim[: self._n] | ~near
        return self._closed(np.where(fixed[:, None], rest, X_CF[:3, 3] + rays * measured[:, None]))

    def _rays(
        self, shape: tuple[int, ...], intrinsics: tuple[float, float, float, float], X_CF: Array
    ) -> tuple[NDArray[Any], ...]:
        """Whether the camera sees each vertex, its ray of unit depth in C, its depth at rest, pixels to look at."""
        (h, w), (fx, fy, cx, cy) = shape, intrinsics
        X_FC = inverse_pose(X_CF)
        p = self.mesh.vertices[: self._n] @ X_FC[:3, :3].T + X_FC[:3, 3]
        at_rest = np.maximum(p[:, 2], 1e-6)
        u, v = (np.rint(f * p[:, i] / at_rest + c).astype(int) for f, i, c in ((fx, 0, cx), (fy, 1, cy)))
        near = (p[:, 2] > 1e-6) & (u >= 0) & (u < w) & (v >= 0) & (v < h)
        index = [np.clip(v + b, 0, h - 1) * w + np.clip(u + a, 0, w - 1) for b in (-1, 0, 1) for a in (-1, 0, 1)]
        return near, (p / at_rest[:, None]) @ X_CF[:3, :3].T, at_rest.astype(np.float32), np.column_stack(index)

    def pressed(self, X_CT: Array, radius: float = RADIUS) -> Array:
        """Vertices as a handle of that radius [m] about z_T presses them, where nothing measures them: a sketch."""
        rest = self.mesh.vertices[: self._n]
        imprint = self._imprint(rest, X_CT, radius)
        dent = (self._fall * imprint.astype(np.float32)).max(axis=1) * (self._free > 0.0)
        beside = self._free * (1.0 - np.exp(-8.0 * np.maximum(1.0 - dent / max(float(dent.max()), 1e-9), 0.0)))
        bulge = _BULGE * float(dent.sum()) / max(float(beside.sum()), 1e-9) * beside if dent.max() > 1e-5 else 0.0
        pressed = rest.copy()
        pressed[:, 1] += self.side * (dent - bulge)
        pressed[:, 1] += self.side * self._imprint(pressed, X_CT, radius)
        return self._closed(pressed)

    def _closed(self, dome: Array) -> Array:
        """The dome's vertices with those of back and apex."""
        return np.concatenate([dome, self.mesh.vertices[-2:-1], dome[-self._sectors :].mean(axis=0, keepdims=True)])

    def _imprint(self, points: Array, X_CT: Array, radius: float) -> Array:
        """How far (n,) [m] points (n, 3) lie beyond the handle's surface, along y_C."""
        X_TC = inverse_pose(X_CT)
        o, d = points @ X_TC[:3, :3].T + X_TC[:3, 3], self.side * X_TC[:3, 1]  # a ray from each point to its camera
        a = max(float(d[0] ** 2 + d[1] ** 2), 1e-9)
        b = o[:, 0] * d[0] + o[:, 1] * d[1]
        root = b * b - a * (o[:, 0] ** 2 + o[:, 1] ** 2 - radius**2)
        way = (-b + np.sqrt(np.maximum(root, 0.0))) / a
        deep = np.where((root > 0.0) & (way > 0.0), way, 0.0)
        deep[self._rim[: self._n]] = 0.0
        return np.minimum(deep, HEIGHT)


class SheetBubble:
    """A bubble whose nodes come from a model of its membrane; closed by a back in the plane of its rim.

    Args:
        triangles: (m, 3) indices of the membrane's nodes.
        turn: the triangles face the camera, not the tool.
    """

    def __init__(self, triangles: Faces, turn: bool = False) -> None:
        sheet = np.asarray(triangles)[:, ::-1] if turn else np.asarray(triangles)
        edges = np.concatenate([sheet[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
        known = {(int(a), int(b)) for a, b in edges}
        rim = [(a, b) for a, b in known if (b, a) not in known]
        self._rim = np.array(sorted({a for a, _ in rim}))
        back = int(sheet.max()) + 1
        self.faces = np.concatenate([sheet, [(b, a, back) for a, b in rim]]).astype(np.int32)

    def vertices(self, nodes: Array) -> Array:
        """Vertices (n + 1, 3) from the membrane's nodes (n, 3) in C [m]."""
        return np.concatenate([nodes, nodes[self._rim].mean(axis=0, keepdims=True)])
