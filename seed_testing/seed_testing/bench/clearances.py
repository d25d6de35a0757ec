# SPDX-License-Identifier: Apache-2.0
"""Random motions of a UR among random boxes: how near it comes, and what the looks ahead cost (docs/keeping_clear.md).

python -m seed_testing.bench.clearances [COUNT [SEED]]
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from seed_core.arm.quaternion import as_quaternion, to_pose, turned
from seed_core.spatial import Array
from seed_core.vector3 import as_vector3
from seed_driver.config import DriverConfig
from seed_driver.motion.joint_speeds import JointSpeeds
from seed_driver.motion.limiter import CommandLimiter
from seed_driver.motion.stop_check import StopCheck
from seed_testing.figures import figures
from seed_ur import MODELS, URKinematics

DT = 0.002  # [s]
_TOP = 2.0  # [rad/s] of a joint
_EVERY = 5  # steps between poses that are judged
_SETTLED = 1e-7  # [m, rad] of a step at which a motion has ended


class Cell:
    """A random arm in a random cell at rest, clear of everything."""

    def __init__(self, seed: int, folder: Path) -> None:
        rng = self.rng = np.random.default_rng(seed)
        hand, around = folder / "hand.yaml", folder / "cell.yaml"
        hand.write_text("/**: {ros__parameters: {hand: {}, tool: {}}}")
        self.arm = URKinematics.for_model(str(rng.choice(sorted(MODELS))))
        while True:
            boxes = [
                {
                    "name": f"box {i}",
                    "position": rng.uniform((-0.9, -0.9, 0.0), (0.9, 0.9, 1.0)).tolist(),
                    "size": rng.uniform(0.1, 0.5, 3).tolist(),
                    "rpy_deg": rng.uniform(-180.0, 180.0, 3).tolist(),
                }
                for i in range(2)
            ]
            around.write_text(yaml.safe_dump({"boxes": boxes}))
            self.config = DriverConfig(
                robot_ip="127.0.0.1",
                hand_file=str(hand),
                surroundings_file=str(around),
                max_speed=float(rng.uniform(0.05, 1.0)),
                max_angular_speed=float(rng.uniform(0.1, 1.5)),
                max_acceleration=float(rng.uniform(0.5, 4.0)),
                max_angular_acceleration=float(rng.uniform(2.0, 8.0)),
            )
            self.check = StopCheck(self.arm, self.config, _TOP)
            self.q = rng.uniform(-3.0, 3.0, 6)
            if self.check.clearances.values([self.q.tolist()])[0].min() > 0.0:
                return

    def move(self) -> tuple[str, Array, list[float]]:
        """Follow a straight line of up to 0.6 m and 2 rad.

        Returns:
            Why it held; the rows (m, rows) on the way; CPU time [us] of each step's check.
        """
        X, rng, spent = self.arm.forward(self.q), self.rng, []
        limiter = CommandLimiter(as_vector3(X[:3, 3]), as_quaternion(X[:3, :3]), DT, self.config)
        joints = JointSpeeds(self.arm, _TOP)
        joints.restart(tuple(self.q))
        way, turn, p, q = rng.uniform(-0.35, 0.35, 3), rng.uniform(-1.2, 1.2, 3), limiter.p, limiter.q
        speed, angular_speed = self.config.max_speed, self.config.max_angular_speed
        steps = max(float(np.linalg.norm(way)) / speed, float(np.linalg.norm(turn)) / angular_speed) / (0.9 * DT)
        at, places, reason = list(self.q), [list(self.q)], ""
        for i in range(int(steps) + 2000):
            if not reason:
                share = min(1.0, i / steps)
                target = as_vector3(np.array(p) + share * way), turned(q, as_vector3(share * turn))
                limiter.follow(*target, i * DT, 0.1)
            limiter.propose()
            why = joints.limit(limiter)  # in every step, as the driver does: a stop too keeps to where the arm can go
            began = time.thread_time()
            why = why or self.check.check(limiter, joints.q)
            spent.append(1e6 * (time.thread_time() - began))
            limiter.advance()
            reason = reason or why
            if reason:
                limiter.hold()
            before, at = at, self.arm.follow(to_pose(limiter.p, limiter.q), at)
            if i % _EVERY == 0:
                places.append(at)
            if i > steps and np.abs(np.subtract(at, before)).max() < _SETTLED:
                break
        return reason, self.check.clearances.values([*places, at]), spent


def run(count: int = 60, seed: int = 0) -> dict[str, object]:
    """Figures of `count` random motions: how many held, the least distance [mm], and CPU times of a check [us]."""
    held, least, spent = 0, np.inf, []
    for i in range(count):
        with tempfile.TemporaryDirectory() as folder:
            reason, rows, times = Cell(seed + i, Path(folder)).move()
        held += "at least" in reason
        least = min(least, float(rows.min()))
        spent += times
    looks = [t for t in spent if t > 20.0]  # the others were skipped, because everything was far
    return {
        "motions": count,
        "held": held,
        "least_beyond_clearance_mm": 1e3 * least,
        "looks_share": len(looks) / len(spent),
        "mean_us_per_cycle": float(np.mean(spent)),
        **figures("look_{}_us", looks, "median", "p99"),
    }


def main() -> int:
    """Print the figures."""
    print(run(*map(int, sys.argv[1:])))
    return 0


if __name__ == "__main__":
    sys.exit(main())
