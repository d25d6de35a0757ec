# SPDX-License-Identifier: Apache-2.0
"""The bodies of UR arms as capsules: every point nearer than a radius to a segment.

Each capsule is fixed in one of the frames of `URKinematics.frames`, 1 to 6, in the base (0), or on the flange (7).
Together those of a link enclose its collision mesh in Universal_Robots_ROS2_Description 2.4.5 (meshes/*/collision): of
points every 6 mm on the meshes' surfaces none lies outside.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_core.vector3 import Vector3

HAND = 7  # frame of what is mounted on the flange: as frame 6, the last link's


@dataclass(frozen=True)
class Capsule:
    """One capsule: the segment from `start` to `end` [m] in its frame, and a radius [m]."""

    body: str  # what a person at the arm would call it
    frame: int
    start: Vector3
    end: Vector3
    radius: float


UR5E = (
    Capsule("base", 0, (0.0, 0.0, 0.03), (0.0, 0.0, 0.09), 0.083),
    Capsule("shoulder", 1, (0.0, -0.04, 0.0), (0.0, 0.024, 0.007), 0.073),
    Capsule("shoulder", 1, (0.0, 0.005, 0.03), (0.0, 0.005, 0.045), 0.073),
    Capsule("upper arm", 2, (0.41, 0.0, 0.105), (0.41, 0.0, 0.16), 0.08),
    Capsule("upper arm", 2, (0.07, 0.0, 0.131), (0.34, 0.0, 0.134), 0.091),
    Capsule("upper arm", 2, (0.015, 0.0, 0.088), (0.015, 0.0, 0.161), 0.078),
    Capsule("forearm", 3, (0.38, 0.0, 0.01), (0.38, 0.0, 0.03), 0.078),
    Capsule("forearm", 3, (0.05, 0.0, 0.008), (0.34, 0.0, 0.022), 0.068),
    Capsule("forearm", 3, (0.008, 0.0, -0.017), (0.008, 0.0, 0.045), 0.05),
    Capsule("wrist 1", 4, (0.0, -0.04, 0.0), (0.0, 0.0, 0.0), 0.053),
    Capsule("wrist 1", 4, (0.0, -0.006, -0.028), (0.0, -0.006, 0.033), 0.048),
    Capsule("wrist 2", 5, (0.0, 0.03, 0.0), (0.0, 0.0, 0.0), 0.045),
    Capsule("wrist 2", 5, (0.0, 0.004, -0.026), (0.0, 0.004, 0.028), 0.049),
    Capsule("wrist 3", 6, (0.0, -0.002, -0.027), (0.0, -0.002, -0.018), 0.046),
)
UR10E = (
    Capsule("base", 0, (0.0, 0.0, 0.03), (0.0, 0.0, 0.08), 0.102),
    Capsule("shoulder", 1, (0.0, -0.046, 0.0), (0.0, 0.033, 0.008), 0.093),
    Capsule("shoulder", 1, (0.0, 0.0, 0.04), (0.0, 0.004, 0.06), 0.093),
    Capsule("upper arm", 2, (0.596, 0.0, 0.125), (0.596, 0.0, 0.21), 0.098),
    Capsule("upper arm", 2, (0.117, 0.0, 0.173), (0.53, 0.0, 0.176), 0.11),
    Capsule("upper arm", 2, (0.018, 0.0, 0.121), (0.018, 0.0, 0.194), 0.081),
    Capsule("forearm", 3, (0.555, 0.0, 0.043), (0.555, 0.0, 0.07), 0.082),
    Capsule("forearm", 3, (0.007, 0.0, 0.048), (0.51, 0.0, 0.055), 0.076),
    Capsule("forearm", 3, (0.0, 0.0, 0.03), (0.0, 0.0, 0.072), 0.06),
    Capsule("wrist 1", 4, (0.0, -0.03, 0.0), (0.0, 0.0, 0.0), 0.061),
    Capsule("wrist 1", 4, (0.0, -0.006, -0.021), (0.0, -0.006, 0.037), 0.06),
    Capsule("wrist 2", 5, (0.0, 0.03, 0.0), (0.0, 0.0, 0.0), 0.055),
    Capsule("wrist 2", 5, (0.0, 0.004, -0.016), (0.0, 0.004, 0.033), 0.06),
    Capsule("wrist 3", 6, (0.0, -0.003, -0.029), (0.0, -0.003, -0.016), 0.053),
)
ARMS: Mapping[str, tuple[Capsule, ...]] = MappingProxyType({"ur5e": UR5E, "ur10e": UR10E})
# Frames whose bodies touch in any pose, or are kept apart by the joints between: base and upper arm, for example.
JOINED = frozenset({(0, 1), (0, 2), (1, 2), (2, 3), (3, 4), (3, 5), (4, 5), (4, 6), (5, 6), (5, 7), (6, 7)})


def arm_capsules(model: str) -> tuple[Capsule, ...]:
    """The capsules of the arm called `model`; raises SeedError naming the known ones."""
    if model not in ARMS:
        raise SeedError(f"there are no capsules of '{model}'; choose one of {', '.join(ARMS)}")
    return ARMS[model]


class Skeleton:
    """The segments of capsules, laid out for all frames at once.

    Attributes:
        capsules: n of them.
        radii: (n,) [m].
    """

    def __init__(self, capsules: Sequence[Capsule]) -> None:
        self.capsules = tuple(capsules)
        self.radii = np.array([c.radius for c in capsules])
        self._frames = np.array([c.frame for c in capsules] * 2)
        points = np.array([c.start for c in capsules] + [c.end for c in capsules])
        self._points = np.concatenate((points, np.ones((len(points), 1))), axis=1)[:, :, None]

    def segments(self, frames: Array) -> tuple[Array, Array]:
        """Both ends (..., n, 3) [m] of every segment, for frames 0 to 7 (..., 8, 4, 4) in the base."""
        ends = (frames[..., self._frames, :3, :] @ self._points)[..., 0]
        n = len(self.capsules)
        return ends[..., :n, :], ends[..., n:, :]
