# SPDX-License-Identifier: Apache-2.0
"""Membranes without a force sensor: a known weight hangs between them, and the hand is turned; images tell the rest.

The tool is grasped while something carries it, which is where motions count from. Then it hangs, and the hand goes
from attitude to attitude, slowly enough for the estimator to follow.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.hand import weight_about_T
from seed_core.membrane.features import Motions, by_finger
from seed_core.spatial import Array, Wrench, make_pose, rotation_from_rpy, so3_exp, so3_log
from seed_sim.identification.scenario import IdentificationScenario
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.membrane import MembraneError
from seed_sysid.fit.weight import ORIENTATIONS_DEG, WeightError
from seed_sysid.membrane.weights import WeightSlopes, expected_load, fit_weights
from seed_sysid.report.weight import slope_figures

_TURN, _PARTS = np.deg2rad(6.0), 12  # [rad] of the hand between images; parts in which the weight is let go
_CHECKED, _LIGHTER = 3, 0.5  # attitudes in which the slopes have to tell the load of a lighter weight; its share
_FRAME, _IMAGES = 0.05, 4  # [s] between images; of them that an attitude averages


class _Hand:
    """The hand with its membranes, the hanging tool, and the estimator that looks at it."""

    def __init__(self, scenario: IdentificationScenario, seed: int) -> None:
        self._poses = TactilePoses(scenario, seed)
        assert self._poses.hold is not None
        self.hold, self._weight, self._t = self._poses.hold, scenario.weight, 0.0
        self._X_CT, self._R = np.eye(4), np.eye(3)

    def see(self, R_WC: Array, share: float) -> RelativePoseEstimate:
        """With the hand at R_WC (3, 3) and a share of the tool's weight on it; MembraneError where it is not borne."""
        weight = self._weight
        load = weight_about_T(share * weight.mass, np.array(weight.center_of_mass), R_WC @ self._X_CT[:3, :3])
        self._X_CT = self.hold.under(load)
        self._t += _FRAME
        estimate = self._poses.look(self._X_CT, self._t)
        if not estimate.valid:
            raise WeightError(f"the estimator lost the tool: {estimate.reason}")
        return estimate

    def turn(self, attitude: tuple[float, float], share: float) -> tuple[Motions, Array, Array]:
        """Turn slowly to roll and pitch [deg]; motions there, X_CT (4, 4), and the load (6,) about T, in T."""
        goal = rotation_from_rpy(np.deg2rad([*attitude, 0.0]))
        way = so3_log(self._R.T @ goal)
        steps = max(1, int(np.ceil(np.linalg.norm(way) / _TURN)))
        for i in range(1, steps + 1):
            self.see(self._R @ so3_exp(way * i / steps), share)
        self._R = goal
        estimates = [self.see(goal, share) for _ in range(_IMAGES)]
        X_CT, weight = estimates[-1].X_CT, self._weight
        load = weight_about_T(share * weight.mass, np.array(weight.center_of_mass), goal @ X_CT[:3, :3])
        return by_finger(_mean(estimates)), X_CT, Wrench.zero().minus(load).vector()


def identify_membranes_with_weight(
    scenario: IdentificationScenario, seed: int, attitudes: Sequence[tuple[float, float]] = ORIENTATIONS_DEG
) -> tuple[WeightSlopes, dict[str, Any]]:
    """Simulate and fit; the slopes with their intervals, and all figures as plain data.

    Args:
        scenario: with membranes, and the weight.
        seed: of the images' noise.
        attitudes: roll and pitch of the hand [deg], in order.

    Raises:
        WeightError: the estimator loses the tool, or the weight tells nothing.
        MembraneError: the membranes cannot be inflated.
    """
    hand, weight = _Hand(scenario, seed), scenario.weight
    at_rest = hand.see(np.eye(3), 0.0)
    middles = np.array([m.centroid for m in by_finger(at_rest.membrane)])
    try:
        for share in np.linspace(0.0, 1.0, _PARTS):
            hand.see(np.eye(3), float(share))
        seen = [hand.turn(attitude, 1.0) for attitude in attitudes]
        lighter = [hand.turn(attitude, _LIGHTER) for attitude in attitudes[:_CHECKED]]
    except MembraneError as error:
        raise WeightError(f"{weight.mass:g} kg tear the tool out of this grasp: take less ({error})") from error
    motions, X_CT, loads = zip(*seen, strict=True)
    found = fit_weights(motions, middles, np.array(X_CT), np.array(loads))
    off = [expected_load(found, motion, middles, X)[3:] - load[3:] for motion, X, load in lighter]
    largest = np.linalg.norm([load[3:] for _, _, load in lighter], axis=1).max()
    check = {"off": float(np.sqrt(np.mean(np.square(off)) * 3.0)), "load": float(largest)}
    figures = {"procedure": "weight", **slope_figures(found), "mass": weight.mass}
    figures |= {"scenario": scenario.name, "seed": seed, "attitudes": len(seen), "lighter": check}
    return found, figures


def _mean(estimates: list[RelativePoseEstimate]) -> tuple[MembraneMotion, ...]:
    """Motions averaged over images of the same attitude, finger by finger."""
    out = []
    for same in zip(*(by_finger(e.membrane) for e in estimates), strict=True):
        first = same[0].X_CM
        turn = np.mean([so3_log(m.X_CM[:3, :3] @ first[:3, :3].T) for m in same], axis=0)
        X = make_pose(so3_exp(turn) @ first[:3, :3], np.mean([m.X_CM[:3, 3] for m in same], axis=0))
        deformation = np.mean([m.deformation for m in same], axis=0)
        out.append(MembraneMotion(same[0].finger, X, deformation=deformation, centroid=same[0].centroid))
    return tuple(out)
