# SPDX-License-Identifier: Apache-2.0
"""Problems of identification whose unknowns are known, made by the bushing of seed_core."""

import numpy as np

from seed_core.bushing import Bushing, Stiffness
from seed_core.spatial import pose_from_rpy, so3_exp
from seed_sysid.fit.load_model import Problem, Unknowns
from seed_sysid.stiffness_map import stiffness_map

GRIPS, POSES = 2, 40  # per grip
NOISE = np.array([0.002, 0.003, 0.004, 0.05, 0.1, 0.08])  # [N m, N]
TRUTH = Unknowns(
    stiffness=np.array([[4.0, 3.0, 5.0, 800.0, 1200.0, 600.0], [5.0, 3.5, 4.0, 900.0, 1500.0, 700.0]]),
    offset=np.array([0.03, -0.04, 0.02, 0.003, -0.004, 0.002]),
    bias=np.array([[0.1, -0.2, 0.05, 1.0, -2.0, 3.0], [0.2, 0.1, -0.05, -1.0, 0.5, 2.0]]),
    drift=np.array([0.01, -0.02, 0.03, 0.4, -0.3, 0.2]),
    friction=np.zeros(6),
)


def random_poses(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.array([pose_from_rpy(rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.01, 0.01, 3)) for _ in range(n)])


def made(
    seed: int = 1, noise: float = 0.0, poses: int = POSES, combined: float = 1.0, friction: float = 0.0
) -> tuple[Problem, Unknowns]:
    """A problem, and the unknowns that it was made with; wrenches by the bushing of seed_core, moved by hand.

    Half the poses are combinations, whose noise is `combined` times that of the others.
    """
    rng = np.random.default_rng(seed)
    n = GRIPS * poses
    X_TC, grip, time = random_poses(rng, n), np.arange(n) % GRIPS, np.linspace(1000.0, 1600.0, n)
    group = (np.arange(n) // GRIPS) % 2
    z, truth = rng.uniform(-1.0, 1.0, (n, 6)), TRUTH._replace(friction=friction * np.array([0, 0.1, 0, 0, 1.0, 0]))
    R, p = so3_exp(truth.offset[:3]), truth.offset[3:]
    wrench = np.empty((n, 6))
    for i, X in enumerate(X_TC):
        load = Bushing(Stiffness.from_vector(truth.stiffness[grip[i]])).wrench(X).vector()
        load += stiffness_map(X[None]).B[0] @ (truth.friction * z[i])
        torque, force = R @ load[:3], R @ load[3:]
        s = (time[i] - 1300.0) / 600.0
        wrench[i] = np.concatenate([torque + np.cross(p, force), force]) + truth.bias[grip[i]] + s * truth.drift
    wrench += noise * NOISE * np.where(group, combined, 1.0)[:, None] * rng.normal(size=(n, 6))
    hysteretic = (1, 4) if friction else ()
    index = np.arange(n)
    return Problem(X_TC, wrench, grip, time, group, X_TC, index, z, hysteretic), truth
