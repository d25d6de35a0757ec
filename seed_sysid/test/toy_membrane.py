# SPDX-License-Identifier: Apache-2.0
"""A toy of a grasp with two elastic patches on which a tool slides: no history but Coulomb's, cheap, unlike the map.

Each finger's patch is a grid of points in C, every one held by a spring to the frame and by springs to its neighbours,
all stiffening with their stretch. Points stick to the tool until the tangential force exceeds friction times the normal
one, then slide along. The wrench on the tool is the sum of what the points pull, a smooth function of where they are.
"""

from dataclasses import dataclass

import numpy as np

from seed_core.estimate import MembraneMotion
from seed_core.membrane.material import deformation, rigid_motion
from seed_core.spatial import Array, inverse_pose, pose_from_rpy
from seed_sysid.data.dataset import Dataset, Header, Sample, flat_pose
from seed_sysid.data.membrane_sample import mean_membrane
from seed_sysid.parameters import Procedure
from seed_sysid.run.excitation import designs
from seed_sysid.stiffness_map import wrench_transform

_U, _V = (g.ravel() for g in np.meshgrid(np.linspace(-1, 1, 3), np.linspace(-1, 1, 7)))
_N = len(_U)
_LAPLACE = np.array([[float(np.hypot(a - c, 3 * (b - d)) < 1.05) for c, d in zip(_U, _V, strict=True)]
                     for a, b in zip(_U, _V, strict=True)])  # fmt: skip
_LAPLACE = np.diag(_LAPLACE.sum(axis=1)) - _LAPLACE
GRIPS = ((1.0, 0.026, 1020.0), (1.15, 0.020, 1030.0), (1.3, 0.014, 1040.0))  # stiffness, width [m], pressure [hPa]


@dataclass
class Toy:
    """friction: of points on the tool; curvature: share of stiffening at 5 mm; aside: of the patches along z [m]."""

    friction: float = 1.0
    curvature: float = 0.3
    grip: int = 1
    aside: float = 0.0

    def __post_init__(self) -> None:
        x, z = 0.006 * _U, 0.015 * _V + self.aside
        self.rest = [np.stack([x, np.full(_N, side * 0.012), z], 1) for side in (1.0, -1.0)]
        self.on_tool = [p.copy() for p in self.rest]
        self.x = [p.copy() for p in self.rest]
        self.slips = 0.0
        scale = GRIPS[self.grip][0]
        self.K = scale * np.array([300.0, 450.0, 300.0]) / _N
        self.normal = scale * 0.9 / _N

    def pull(self, f: int, x: Array) -> Array:
        """(n, 3) [N] of each point on the tool, where the points are at x."""
        d = x - self.rest[f]
        stretch = 1.0 + self.curvature * (d**2).sum(axis=1, keepdims=True) / 0.005**2
        return np.asarray(-self.K * (stretch * d + 0.5 * (_LAPLACE @ d)))

    def move(self, X_CT: Array) -> Array:
        """(6,) load on the tool about C, in C, once it has gone to X_CT (in one step, as poses do)."""
        slid = 0
        for f in (0, 1):
            x = self.on_tool[f] @ X_CT[:3, :3].T + X_CT[:3, 3]
            n = X_CT[:3, 1]
            for _ in range(60):
                force = self.pull(f, x)
                tangent = force - np.outer(force @ n, n)
                size = np.linalg.norm(tangent, axis=1, keepdims=True)
                most = self.friction * np.maximum(self.normal + 0.2 * np.abs(force @ n)[:, None], 0.0)
                over = np.maximum(size - most, 0.0)
                if over.max() < 1e-5:
                    break
                x = x + 0.4 * over * tangent / np.maximum(size, 1e-9) / (2.0 * self.K[0])
            moved = np.linalg.norm(x - self.on_tool[f] @ X_CT[:3, :3].T - X_CT[:3, 3], axis=1) > 1e-5
            slid += int(moved.sum())
            self.on_tool[f] = (x - X_CT[:3, 3]) @ X_CT[:3, :3]
            self.x[f] = x
        self.slips = slid / (2 * _N)
        out = np.zeros(6)
        for f in (0, 1):
            force = self.pull(f, self.x[f])
            out += np.concatenate([np.cross(self.x[f], force).sum(axis=0), force.sum(axis=0)])
        return out

    def membrane(self) -> tuple[MembraneMotion, ...]:
        """What an estimator without error tells."""
        out = []
        for f, name in enumerate(("left", "right")):
            X = rigid_motion(self.rest[f].T, self.x[f].T)
            push = float((self.x[f] - self.rest[f])[:, 1].mean()) * (1.0 if f == 0 else -1.0)
            out.append(
                MembraneMotion(
                    finger=name,
                    X_CM=X,
                    deformation=deformation(X, self.rest[f].T, self.x[f].T),
                    area=4e-4,
                    centroid=self.rest[f].mean(axis=0),
                    pressure=GRIPS[self.grip][2] + 200.0 * -push,
                )
            )
        return tuple(out)


def toy_dataset(
    rng: np.random.Generator,
    friction: float = 1.0,
    curvature: float = 0.3,
    offset: Array | None = None,
    widths: int = 3,
    aside: float = 0.0,
) -> Dataset:
    """The suite's own procedure on the toy, at rest at every pose, with the noise of a sensor."""
    to_sensor = np.eye(6) if offset is None else wrench_transform(offset)
    samples, stamp = [], 0.0
    for grip, targets in enumerate(designs(Procedure())[:widths]):
        toy = Toy(friction, curvature, grip, aside)
        for target in targets:
            stamp += 4.0
            X_CT = inverse_pose(target.X_TC)
            load = to_sensor @ wrench_transform(target.X_TC) @ toy.move(X_CT)
            noise = rng.normal(size=6) * np.repeat([5e-4, 0.02], 3)
            samples.append(
                Sample(
                    name=target.name,
                    kind=target.kind,
                    grip=grip,
                    stamp=stamp,
                    kinematic=flat_pose(target.X_TC),
                    wrench=tuple((load + noise).tolist()),
                    pressures=(GRIPS[grip][2],) * 2,
                    width=GRIPS[grip][1],
                    settle=2.0,
                    readings=6,
                    membrane=mean_membrane([toy.membrane()]),
                )
            )
    return Dataset(Header(hand="h", tool="t", created="2026-01-31"), samples)


def combined_motion(rng: np.random.Generator, n: int = 120, size: float = 1.0) -> list[Array]:
    """X_CT of a smooth six-axis motion of 2 mm and 4 degrees rms."""
    t = np.arange(n) * 0.1
    waves = np.sin(2 * np.pi * rng.uniform(0.05, 0.25, (6, 3, 1)) * t + rng.uniform(0, 6, (6, 3, 1))).sum(axis=1)
    values = np.array([size * w / np.std(w) for w in waves]).T * np.repeat([np.deg2rad(4.0), 2e-3], 3)
    return [pose_from_rpy(v[:3], v[3:]) for v in values]
