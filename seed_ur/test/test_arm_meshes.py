# SPDX-License-Identifier: Apache-2.0
"""The drawn arm stands where the kinematics say, within the capsules that enclose the real one."""

from itertools import pairwise

import numpy as np
import pytest

from seed_core import SeedError
from seed_ur.capsules import arm_capsules
from seed_ur.kinematics import URKinematics
from seed_ur.meshes import arm_parts, arm_poses

Q = np.array((0.3, -1.2, 1.8, -2.1, -1.5, 0.4))


@pytest.mark.parametrize("model", ["ur5e", "ur10e"])
def test_links_lie_within_the_capsules_of_the_arm(model: str) -> None:
    for part in arm_parts(model)[:7]:
        points = part.mesh.vertices
        assert np.isfinite(points).all()
        inside = np.zeros(len(points), bool)
        for c in (c for c in arm_capsules(model) if c.frame == part.frame):
            a, b = np.array(c.start), np.array(c.end)
            s = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
            inside |= np.linalg.norm(points - a - s[:, None] * (b - a), axis=1) <= c.radius + 1e-3
        assert inside.mean() > 0.95, part.name


def test_the_last_pose_is_the_flange() -> None:
    poses = arm_poses("ur5e", Q)
    np.testing.assert_allclose(poses[0], np.eye(4))
    np.testing.assert_allclose(poses[6], URKinematics.for_model("ur5e").forward(Q))


@pytest.mark.parametrize("model", ["ur5e", "ur10e"])
def test_neighbouring_links_meet(model: str) -> None:
    parts, poses = arm_parts(model)[:7], arm_poses(model, Q)
    placed = [p.mesh.moved(poses[int(p.frame)]).vertices for p in parts]
    for one, other in pairwise(placed):
        apart = np.linalg.norm(one[:, None, :] - other[None, :, :], axis=2).min()
        assert apart < 0.03


def test_an_unknown_arm_is_named() -> None:
    with pytest.raises(SeedError, match="'puma'"):
        arm_parts("puma")
