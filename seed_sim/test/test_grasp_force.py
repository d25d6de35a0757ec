# SPDX-License-Identifier: Apache-2.0
"""A grasp from outside Drake loads the tool as one inside would."""

import numpy as np
from numpy.testing import assert_allclose

from seed_core.bushing import Bushing
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, rpy_from_rotation, so3_exp, so3_log
from seed_sim.plant.plant import DT, Plant
from seed_sim.scenario import Scenario, ServoSection, TableSection

CELL = Scenario(table=TableSection(tilt_x=(1.5, 1.5), tilt_y=(-1.0, -1.0), height=(0.0, 0.0)))
WORK = make_pose(None, (0.45, 0.0, 0.0))


class DampedBushing:
    """The stiffness map and a damper, written here from their definitions: torques act on gimbal rates, forces on the
    velocity seen from the frame half way between T and C."""

    def __init__(self, plant: Plant) -> None:
        self._bushing = Bushing(plant.stiffness)
        self._rotational, self._translational = plant.grip.damping
        self.asked, self.latest = 0, 0.0

    def wrench(self, X_TC: Array, V_TC: Array, t: float) -> Wrench:
        self.asked += 1
        self.latest = t
        R, p = X_TC[:3, :3], X_TC[:3, 3]
        _, pitch, yaw = rpy_from_rotation(R)
        c, s = np.cos(yaw), np.sin(yaw)
        N = np.array(
            (
                (c / np.cos(pitch), s / np.cos(pitch), 0.0),
                (-s, c, 0.0),
                (c * np.tan(pitch), s * np.tan(pitch), 1.0),
            )
        )
        R_TB = so3_exp(0.5 * so3_log(R))
        velocity = V_TC[3:] - 0.5 * np.cross(V_TC[:3], p)
        force = R_TB @ (self._translational * (R_TB.T @ velocity))
        torque = N.T @ (self._rotational * (N @ V_TC[:3])) + 0.5 * np.cross(p, force)
        return self._bushing.wrench(X_TC).plus(Wrench(torque, force))

    def reset(self, t: float) -> None:
        self.asked, self.latest = 0, t


def flange(height: float) -> Array:
    """X_WE (4, 4) with the undeflected tip `height` above the nominal table."""
    X_W_tip = WORK @ make_pose(so3_exp((np.pi, 0.0, 0.0)), (0.0, 0.0, height))
    return X_W_tip @ inverse_pose(CELL.tool.X_Ttip) @ inverse_pose(CELL.hand.X_EC)


def wipe(plant: Plant) -> Array:
    """Come down, turn and drag the blade along x; (n, 18) contact, grasp load, pose of the tool."""
    rows = []
    for step in range(300):
        t = 0.004 * step
        X = flange(max(0.003 - 0.04 * t, -0.01))
        X[0, 3] += 0.1 * max(t - 0.4, 0.0)
        X[:3, :3] = so3_exp((0.1 * np.sin(3.0 * t), 0.15 * np.sin(2.0 * t), 0.2 * np.sin(4.0 * t))) @ X[:3, :3]
        plant.command(X)
        plant.advance(t + 0.004)
        pose = np.concatenate([so3_log(plant.X_CT[:3, :3]), plant.X_CT[:3, 3]])
        rows.append(np.concatenate([plant.contact_wrench.vector(), plant.bushing_wrench.vector(), pose]))
    return np.array(rows)


def test_wipe_with_the_same_spring_and_damper_outside_of_drake_is_the_same_wipe():
    inside = Plant(CELL, 3, WORK, flange(0.003))
    force = DampedBushing(inside)
    outside = Plant(CELL, 3, WORK, flange(0.003), grasp_force=force)
    drake, ours = wipe(inside), wipe(outside)
    assert force.asked >= round(1.2 / DT)
    assert_allclose(force.latest, outside.time)
    assert np.abs(drake[:, 2 + 3]).max() > 5.0  # [N] it presses
    assert np.abs(drake[:, 12:15]).max() > np.deg2rad(3.0)  # the grasp turns: the map's nonlinearity counts
    assert_allclose(ours[:, :12], drake[:, :12], atol=5e-5)  # [N m, N]
    assert_allclose(ours[:, 12:], drake[:, 12:], atol=1e-7)  # [rad, m]


def test_grasp_from_outside_carries_the_tool_where_it_hangs():
    class Stiff:
        """400 N/m along z whatever the stiffness of the scenario, and a damper."""

        def wrench(self, X_TC: Array, V_TC: Array, _: float) -> Wrench:
            turn = so3_log(X_TC[:3, :3])
            return Wrench(4.0 * turn + 0.05 * V_TC[:3], 400.0 * X_TC[:3, 3] + 10.0 * V_TC[3:])

        def reset(self, t: float) -> None:
            pass

    still = Scenario(servo=ServoSection(repeatability=0.0))
    plant = Plant(still, 0, WORK, flange(0.3), grasp_force=Stiff())
    plant.advance(1.5)
    assert_allclose(plant.X_CT[:3, 3], (0.0, 0.0, 9.81 * 0.2 / 400.0), atol=2e-6)  # [m]
    R_WT = plant.X_WT[:3, :3]
    assert_allclose(R_WT @ plant.bushing_wrench.force, (0.0, 0.0, 9.81 * 0.2), atol=1e-3)
