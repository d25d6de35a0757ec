# SPDX-License-Identifier: Apache-2.0
"""The comparison of the cameras' clock with the arm's, in the motion between the poses of an identification."""

from itertools import pairwise

import numpy as np

from seed_core.errors import SeedError
from seed_core.spatial import Array, interpolate_pose, inverse_pose, so3_log
from seed_estimation.calibration.file import Calibration
from seed_sim.scenario import Scenario
from seed_sim.world.cameras import WorldCameras, true_hand
from seed_sim.world.parameters import World
from seed_sim.world.poses import make_estimator, take_grasp
from seed_sysid.fit.clock_offset import FARTHEST, ClockOffset, ClockWatch
from seed_sysid.parameters import Procedure
from seed_sysid.run.excitation import design

_ROBOT = 0.008  # [s] between poses of the arm
_DURATION = 7.0  # [s] of motion
_SHARES = 1.0, 0.6  # [1] of the motion: where the tool slips in the first, it is grasped anew and moved less


def compare_clocks(
    believed: Scenario, world: World, seed: int, method: str, calibration: Calibration | None
) -> ClockOffset:
    """By which the images' stamps of a world are ahead of the arm's.

    Args:
        believed: the cell as it is believed.
        world: what differs.
        seed: of the images' noise.
        method: of the estimator.
        calibration: as found before.

    Raises:
        SeedError: the estimator does not see the grasp, or the clocks cannot be told.
    """
    for share in _SHARES[:-1]:
        try:
            return _compared(share, believed, world, seed, method, calibration)
        except SeedError:
            continue
    return _compared(_SHARES[-1], believed, world, seed, method, calibration)


def _compared(
    share: float, believed: Scenario, world: World, seed: int, method: str, calibration: Calibration | None
) -> ClockOffset:
    """The same in a share of the motion."""
    cameras, period = WorldCameras(believed, world, seed), 1.0 / believed.measurement.rate
    estimator = make_estimator(believed, cameras, calibration, method, period)
    take_grasp(estimator, cameras, np.eye(4), 0.0, period)
    times, X_TC = motion(Procedure(), share)
    X_KC = inverse_pose(believed.hand.X_EC) @ true_hand(believed.hand, world).X_EC
    watch = ClockWatch()
    for t, X in zip(times, X_TC, strict=True):
        watch.robot(t, X)

    def true_X_CT(t: float) -> Array:
        i = min(max(int(t / _ROBOT), 0), len(X_TC) - 2)
        X = interpolate_pose(X_TC[i], X_TC[i + 1], min(max(t / _ROBOT - i, 0.0), 1.0))
        return inverse_pose(inverse_pose(X_KC) @ X @ X_KC)

    clock = world.images.clock
    for n in range(1, int((_DURATION + FARTHEST) / period)):
        t = n * period
        in_time = sorted(cameras.early.items(), key=lambda item: -item[1])  # membranes remember their way
        images = {f: cameras.finger(f, true_X_CT(t - early), t) for f, early in in_time}
        estimate = estimator.update(images, t + clock)
        if estimate.valid:
            watch.camera(estimate.stamp, inverse_pose(estimate.X_CT))
    return watch.offset()


def motion(procedure: Procedure, share: float = 1.0) -> tuple[list[float], list[Array]]:
    """Times [s] and X_TC (4, 4) of the way between the first poses of a procedure, each by a share; rests left out.

    At both ends it rests for as long as offsets are looked for.
    """
    p = procedure
    targets = [interpolate_pose(np.eye(4), t.X_TC, share) for t in design(p.excitation, p.limits, p.fit.model)]
    poses = [targets[0]] * int(FARTHEST / _ROBOT)
    for a, b in pairwise(targets):
        way = float(np.linalg.norm(b[:3, 3] - a[:3, 3])) / p.motion.speed
        turn = float(np.linalg.norm(so3_log(a[:3, :3].T @ b[:3, :3]))) / np.deg2rad(p.motion.turn_rate_deg)
        steps = max(int(max(way, turn) / _ROBOT), 1)
        poses += [interpolate_pose(a, b, i / steps) for i in range(1, steps + 1)]
    return [i * _ROBOT for i in range(len(poses))], poses
