# SPDX-License-Identifier: Apache-2.0
"""The links of UR arms to look at: tubes of the right lengths and about the right thickness, in the arm's frames.

parts = arm_parts("ur5e")
poses = arm_poses("ur5e", q)       # part.mesh stands at poses[part.frame], in the frame W
"""

from functools import lru_cache

import numpy as np

from seed_core.meshes import Part, capsule, cylinder, joined
from seed_core.spatial import Array
from seed_ur.capsules import Capsule, arm_capsules
from seed_ur.kinematics import URKinematics

GREY, CAP = (205, 210, 218), (86, 148, 206)
_SLIM = 0.82  # of a collision capsule's radius: those enclose the links, with their caps and cables
LINKS = ("base", "shoulder", "upper arm", "forearm", "wrist 1", "wrist 2", "wrist 3")


def arm_parts(model: str) -> list[Part]:
    """One mesh for each link, base to wrist 3, and the joints' blue caps; `frame` counts as in `arm_poses`.

    Raises:
        SeedError: no such arm.
    """
    by_frame: dict[int, list[Capsule]] = {}
    for c in arm_capsules(model):
        by_frame.setdefault(c.frame, []).append(c)
    parts = []
    for frame, name in enumerate(LINKS):
        bodies = [capsule(_SLIM * c.radius, c.start, c.end, 24) for c in by_frame[frame]]
        parts.append(Part(name, frame, joined(bodies), GREY))
    return parts + _caps(by_frame)


def _caps(by_frame: dict[int, list[Capsule]]) -> list[Part]:
    """Discs at the joints' ends, by which one knows such an arm."""
    radius = {i: _SLIM * by_frame[i][-1].radius for i in by_frame}
    out = [(1, 2, -1.0), (4, 1, -1.0), (5, 1, 1.0)]  # frame, axis and way of a cap
    caps = []
    for frame, axis, way in out:
        r = 0.8 * radius[frame]
        along = np.eye(3)[axis] * way
        reach = max(float(np.dot(p, along)) + _SLIM * c.radius for c in by_frame[frame] for p in (c.start, c.end))
        caps.append(Part(f"cap {frame}", frame, cylinder(r, (reach - 0.012) * along, (reach + 0.002) * along, 24), CAP))
    return caps


@lru_cache(maxsize=4)
def _kinematics(model: str) -> URKinematics:
    return URKinematics.for_model(model)


def arm_poses(model: str, q: Array) -> Array:
    """(7, 4, 4) poses in W of the base and the six links, for joint angles q (6,) [rad]; the last is the flange E."""
    return np.concatenate([np.eye(4)[None], _kinematics(model).frames(q)])
