# SPDX-License-Identifier: Apache-2.0
"""The identification cell on membranes reads what the membranes do, whichever way the tool has come."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.membrane.material import around, rigid_motion
from seed_core.spatial import inverse_pose, make_pose, rotation_error, so3_exp
from seed_sim.identification.membrane_cell import MembraneCell, cell_of
from seed_sim.identification.scenario import HiddenGrasp, IdentificationScenario, SensorFaults, identify_on_membrane
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.membrane import MembraneGrasp, MembraneParameters
from seed_sim.tactile import TactileParameters
from seed_sim.tactile.parameters import HANDLE
from seed_sysid.parameters import Procedure
from seed_sysid.run.procedure import Command

COARSE = MembraneParameters(spacing=0.008, squeeze=0.012)
QUIET = SensorFaults(
    force_noise=0.0, torque_noise=0.0, force_drift=0.0, torque_drift=0.0, offset_mm=0.0, offset_deg=0.0
)
SCENARIO = IdentificationScenario(
    grasp=HiddenGrasp(kind="membrane", pressure_noise=0.0, settle_time=0.01),
    sensor=QUIET,
    repeatability=0.0,
    repeatability_deg=0.0,
    sensor_position=(0.0, 0.0, 0.0),
    sensor_rpy_deg=(0.0, 0.0, 0.0),
    membrane=COARSE,
    tactile=TactileParameters(tool=HANDLE),
    procedure=Procedure(widths=[0.023, 0.02, 0.017]),
)
X_TC = make_pose(so3_exp((0.03, 0.05, -0.02)), (0.002, -0.001, 0.003))


def command(X: np.ndarray, grip: int, measuring: bool = False) -> Command:
    return Command(X, SCENARIO.procedure.widths[grip], grip, "following", measuring=measuring)


@pytest.fixture(scope="module")
def cell() -> MembraneCell:
    return MembraneCell(SCENARIO, 0)


@pytest.mark.parametrize("grip", [0, 2])
def test_sensor_reads_the_membranes_load_at_every_grip(cell, grip):
    for _ in range(4):
        cell.step(command(np.eye(4), grip))
    for _ in range(6):
        reading = cell.step(command(X_TC, grip))
    alone = MembraneGrasp(COARSE, HANDLE)
    alone.close(COARSE.squeeze + 0.5 * (0.02 - SCENARIO.procedure.widths[grip]))
    state = alone.solve(inverse_pose(X_TC), 0.0)
    assert_allclose(reading.wrench, state.wrench.vector(), rtol=1e-3, atol=1e-3)  # [N m, N]
    assert np.linalg.norm(reading.wrench[3:]) > 3.0
    gas = [0.01 * (COARSE.ambient + state.bubbles[name].pressure) for name in ("left", "right")]
    assert_allclose(reading.pressures, gas, atol=1e-3)  # [hPa]
    assert abs(gas[0] - gas[1]) > 0.3  # the tool is nearer to one of them


def test_a_grip_that_is_closed_late_creeps_from_then_on():
    creeping = replace(SCENARIO, rate=8.0, membrane=replace(COARSE, creep=0.2, creep_time=2.0))  # whole binary steps
    cell, gas = MembraneCell(creeping, 0), []
    for stamp in (0.0, 100.0):
        cell.stamp = stamp
        cell.grip_anew()
        gas.append([cell.step(command(np.eye(4), 1)).pressures for _ in range(100)])
    assert_allclose(gas[1], gas[0], atol=1e-3)  # [hPa]
    assert np.ptp(np.array(gas[0])[:, 0]) > 0.05


def test_hidden_stiffness_is_the_tangent_and_rises_with_the_grip(cell):
    y = 4  # a handle with flat sides touches no more of the sheet when squeezed: x and z hardly change
    assert (np.diff(cell.truth.stiffness, axis=0)[:, y] > 100.0).all()  # [N/m]
    assert (np.diff(cell.truth.pressures) > 0.5).all()


def test_the_way_back_reads_differently():
    slippery = replace(SCENARIO, membrane=replace(COARSE, friction=0.4, squeeze=0.008))
    cell = MembraneCell(slippery, 0)
    far, near = make_pose(None, (0.0, 0.0, 0.004)), make_pose(None, (0.0, 0.0, 0.002))
    forth = [cell.step(command(X, 1)).wrench[5] for X in (near, near, near)][-1]
    back = [cell.step(command(X, 1)).wrench[5] for X in (far, far, near, near, near)][-1]
    assert forth - back > 0.1  # [N]


def test_estimates_see_the_membranes_that_the_sensor_feels():
    poses = TactilePoses(SCENARIO, 3)
    cell = cell_of(SCENARIO, 3, poses)
    assert cell.hold is poses.hold
    for share in np.linspace(0.0, 1.0, 4):
        X = make_pose(None, share * X_TC[:3, 3])
        reading = cell.step(command(X, 1, measuring=True))
    assert poses.invalid == 0
    assert_allclose(reading.X_TC_estimated[:3, 3], X_TC[:3, 3], atol=4e-4)  # [m]
    for motion, pressure in zip(reading.membrane, reading.pressures, strict=True):
        assert motion.pressure == pressure
        assert_allclose(motion.X_CM[:3, 3], -X_TC[:3, 3], atol=1e-3)  # the material goes with the tool


def test_the_band_around_each_patch_is_followed_where_the_membranes_have_it():
    scenario = replace(SCENARIO, membrane=replace(COARSE, spacing=0.005))
    poses = TactilePoses(scenario, 3)
    cell = cell_of(scenario, 3, poses)
    for share in np.linspace(0.0, 1.0, 7):
        X = make_pose(so3_exp(share * np.array((0.0, 0.1, 0.0))), share * np.array((0.001, 0.0, 0.003)))
        reading = cell.step(command(X, 1, measuring=True))
    hold = cell.hold
    assert [m.finger for m in reading.membrane] == ["left", "right"]
    for motion in reading.membrane:
        before, after = hold.grasped.bubbles[motion.finger], hold.state.bubbles[motion.finger]
        band = around(before.nodes.T, before.patch.T)
        p, q = before.nodes[band].T, after.nodes[band].T
        middle = p.mean(axis=1)
        off = motion.X_CM[:3, :3] @ middle + motion.X_CM[:3, 3] - q.mean(axis=1)
        assert np.linalg.norm((q - p).mean(axis=1)) > 1e-3
        assert np.abs(off).max() < 2.5e-4  # [m]; nodes 5 mm apart show a band of 7 mm coarsely
        turn = rotation_error(motion.X_CM[:3, :3], rigid_motion(p, q)[:3, :3])
        assert np.abs(turn).max() < np.deg2rad(1.0)


def test_images_of_a_pose_that_rests_keep_the_track():
    poses = TactilePoses(SCENARIO, 3)
    cell = cell_of(SCENARIO, 3, poses)
    way = [make_pose(None, share * X_TC[:3, 3]) for share in (0.0, 0.25, 0.5, 0.75)]
    rests = [make_pose(None, X_TC[:3, 3])] * 30  # for 2.6 s before it is measured
    followed = [cell.step(command(X, 1, measuring=i >= 30)).followed for i, X in enumerate(way + rests)]
    assert followed[-4:] == [True] * 4
    assert False not in followed


def test_random_membranes_come_with_a_firm_grip():
    drawn = identify_on_membrane(IdentificationScenario(), 5)
    assert drawn.grasp.kind == "membrane"
    assert drawn.membrane.squeeze > 0.01
    assert drawn.tactile.tool == HANDLE
    assert drawn == identify_on_membrane(IdentificationScenario(), 5)
