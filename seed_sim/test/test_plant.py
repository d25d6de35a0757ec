# SPDX-License-Identifier: Apache-2.0
"""The simulated cell obeys statics, friction and the stiffness map."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.bushing import Bushing
from seed_core.errors import FailedError
from seed_core.hand import Frame, Tool
from seed_core.spatial import inverse_pose, make_pose, pose_from_rpy, rotation_from_rpy, so3_exp, so3_log
from seed_sim.plant.grip import PlantError
from seed_sim.plant.plant import DT, Plant
from seed_sim.scenario import GraspSection, Scenario, ServoSection, TableSection

FLAT = TableSection(tilt_x=(0.0, 0.0), tilt_y=(0.0, 0.0), height=(0.0, 0.0))
EXACT = ServoSection(repeatability=0.0)
STILL = Scenario(table=FLAT, servo=EXACT)
WORK = make_pose(None, (0.45, 0.0, 0.0))


def flange(scenario: Scenario, height: float, rpy: tuple[float, float, float] = (np.pi, 0.0, 0.0)) -> np.ndarray:
    """X_WE (4, 4) with the undeflected tip `height` above the work frame's origin."""
    X_W_tip = WORK @ pose_from_rpy(rpy, (0.0, 0.0, height))
    return X_W_tip @ inverse_pose(scenario.tool.X_Ttip) @ inverse_pose(scenario.hand.X_EC)


def settled(scenario: Scenario, height: float, seconds: float = 1.0, seed: int = 0, **options: object) -> Plant:
    """A plant that has stood still long enough, having come down at 30 mm/s."""
    plant = Plant(scenario, seed, WORK, flange(scenario, max(height, 0.005)), **options)
    down = max(0.005 - height, 0.0) / 0.03
    while plant.time < down:
        plant.command(flange(scenario, max(0.005 - 0.03 * plant.time, height)))
        plant.advance(plant.time + 0.004)
    plant.command(flange(scenario, height))
    plant.advance(plant.time + seconds)
    return plant


def balance(plant: Plant) -> np.ndarray:
    """[torque, force] of spring and weight and contact about T, in T: zero for a tool at rest."""
    spring = Bushing(plant.stiffness).wrench(inverse_pose(plant.X_CT))
    R_TW = plant.X_WT[:3, :3].T
    weight = R_TW @ np.array((0.0, 0.0, -9.81 * plant.tool.mass))
    com = np.array(plant.tool.center_of_mass)
    contact = plant.contact_wrench.rotated(R_TW).about(-plant.tool.X_Ttip[:3, 3])
    return spring.vector() + np.concatenate([np.cross(com, weight), weight]) - contact.vector()


@pytest.mark.parametrize("rpy", [(np.pi, 0.0, 0.0), (np.pi, 0.5, 0.0), (2.4, -0.3, 0.7)])
def test_hanging_tool_is_carried_by_the_stiffness_map(rpy):
    plant = Plant(STILL, 0, WORK, flange(STILL, 0.3, rpy))
    plant.advance(1.5)
    assert_allclose(balance(plant), np.zeros(6), atol=2e-3)  # [N m, N] of 0.2 kg; what is left of the swing
    assert_allclose(plant.contact_wrench.vector(), np.zeros(6))


def test_hanging_straight_down_it_sags_by_weight_over_stiffness():
    plant = settled(STILL, 0.3, 1.5)
    assert_allclose(plant.X_CT[:3, 3], (0.0, 0.0, 9.81 * 0.2 / 800.0), atol=2e-6)  # [m]


@pytest.mark.parametrize("depth", [0.004, 0.011])
def test_pressed_tool_is_in_balance_and_contact_carries_the_rest(depth):
    plant = settled(STILL, -depth)
    assert_allclose(balance(plant), np.zeros(6), atol=5e-3)
    # two springs in series, the grasp's and the blade's five points, and the weight on top
    k, c = 800.0, 5 * 8000.0
    pressed = (k * depth + 9.81 * 0.2) / (1.0 + k / c)
    assert_allclose(plant.contact_wrench.force[2], -pressed, atol=0.01)  # [N]


def test_tilted_table_turns_the_blade_until_it_lies_flat():
    plant = settled(replace(STILL, table=replace(FLAT, tilt_x=(1.5, 1.5))), -0.012, 1.5)
    tilt = so3_log(plant.X_WT[:3, :3] @ rotation_from_rpy((np.pi, 0.0, 0.0)).T)[0]
    assert 1.0 < np.rad2deg(tilt) < 1.5  # the grasp holds back a little
    assert_allclose(balance(plant), np.zeros(6), atol=5e-3)


def test_sliding_blade_is_held_back_by_friction():
    plant = settled(STILL, -0.012)
    start = plant.time
    for _ in range(300):
        X = flange(STILL, -0.012)
        X[0, 3] += 0.05 * (plant.time - start)
        plant.command(X)
        plant.advance(plant.time + 0.004)
    force = plant.contact_wrench.force  # of the tool on the table: dragged along +x
    assert_allclose(force[0] / -force[2], 0.4, atol=0.01)


def test_energy_of_a_released_tool_only_decays():
    plant = Plant(STILL, 0, WORK, flange(STILL, 0.3))
    bushing, mass, com = Bushing(plant.stiffness), plant.tool.mass, np.append(plant.tool.center_of_mass, 1.0)
    energies = []
    for _ in range(400):
        plant.advance(plant.time + DT)
        drake, context = plant._cell.plant, plant._cell.context
        context.SetDiscreteState(plant._state)
        kinetic = drake.CalcKineticEnergy(context)  # the gripper stands still
        height = (plant.X_WT @ com)[2]
        energies.append(kinetic + bushing.energy(inverse_pose(plant.X_CT)) + mass * 9.81 * height)
    scale = energies[0] - energies[-1]
    assert scale > 1e-3  # [J]
    assert np.diff(energies).max() < 2e-3 * scale  # the explicit step may add a little near standstill


def test_weight_is_what_a_wrist_sensor_reads_in_free_space():
    plant = settled(STILL, 0.3, 1.5)
    R_WE = plant.arm.actual[:3, :3]
    assert_allclose(R_WE @ plant.ft_wrench.force, (0.0, 0.0, -9.81 * 0.2), atol=1e-3)
    lever = (plant.X_WT @ np.append(plant.tool.center_of_mass, 1.0))[:3] - plant.arm.actual[:3, 3]
    assert_allclose(R_WE @ plant.ft_wrench.torque, np.cross(lever, (0.0, 0.0, -9.81 * 0.2)), atol=1e-3)


@pytest.mark.parametrize("welded", [False, True])
def test_wrist_sensor_reads_weight_and_contact_together(welded):
    plant = settled(STILL, -0.0002 if welded else -0.01, 0.5, welded=welded)
    R_WE = plant.arm.actual[:3, :3]
    expected = -plant.contact_wrench.force + np.array((0.0, 0.0, -9.81 * 0.2))
    assert plant.contact_wrench.force[2] < -3.0
    assert_allclose(R_WE @ plant.ft_wrench.force, expected, atol=5e-3)


def test_welded_tool_presses_with_the_stiffness_of_its_contact():
    plant = settled(STILL, -0.0003, 0.5, welded=True)
    assert_allclose(plant.contact_wrench.force[2], -0.0003 * 5 * 8000.0, rtol=0.02)
    assert_allclose(plant.X_CT, np.eye(4), atol=1e-12)


def test_soft_environment_is_as_soft_as_it_says():
    soft = replace(STILL, table=replace(FLAT, total_stiffness=500.0))
    plant = settled(soft, -0.01, 1.5)
    assert_allclose(plant.contact_wrench.force[2], -(800.0 * 0.01 + 1.962) / (1.0 + 800.0 / 500.0), atol=0.02)


def test_firmer_grip_sags_less():
    plant = settled(STILL, 0.3)
    loose = plant.X_CT[2, 3]
    plant.set_gripper_width(STILL.grasp.nominal_width - 1.0 / STILL.grasp.stiffening)  # twice as stiff
    plant.advance(plant.time + 1.0)
    assert_allclose(plant.X_CT[2, 3], 0.5 * loose, rtol=1e-2)
    assert plant.grip.pressure > STILL.grasp.nominal_pressure


def test_impossible_grip_is_refused_and_changes_nothing():
    plant = settled(STILL, 0.3, 0.01)
    with pytest.raises(PlantError, match=r"0\.3 to 4 times") as refused:
        plant.set_gripper_width(0.2)
    narrow, wide = (float(word) for word in re.findall(r"from (\S+) to (\S+) m:", str(refused.value))[0])
    for width in (narrow + 1e-4, wide - 1e-4):
        plant.set_gripper_width(width)
    plant.set_gripper_width(STILL.grasp.nominal_width)
    with pytest.raises(PlantError):
        plant.set_gripper_width(wide + 1e-4)
    assert plant.grip.width == STILL.grasp.nominal_width
    assert plant.stiffness == STILL.grasp.stiffness


@pytest.mark.parametrize(("width", "touches"), [(0.2, True), (0.04, False)])
def test_a_leaning_blade_touches_with_its_edge_as_wide_as_it_is(width, touches):
    """Leaning by 5 degrees, its edge is 8.7 mm below its middle, or 1.7 mm; the middle is 5 mm above the table."""
    scenario = replace(STILL, blade_width=width)
    plant = Plant(scenario, 0, WORK, flange(scenario, 0.005, (np.pi + np.deg2rad(5.0), 0.0, 0.0)))
    plant.advance(0.3)
    assert (np.linalg.norm(plant.contact_wrench.force) > 0.1) == touches


def test_light_tool_is_cut_into_substeps_and_stays_finite():
    pen = replace(
        STILL,
        tool_kind="pen",
        tool=Tool("pen", Frame((0.0, 0.0, 0.08)), 0.02, (0.0, 0.0, 0.02)),
        grasp=GraspSection(pad_mass=0.02, pad_radius=0.02),
    )
    plant = settled(pen, -0.003, 0.5)
    assert plant.grip.substeps > 1
    assert_allclose(balance(plant), np.zeros(6), atol=5e-3)


def test_tool_too_light_for_any_step_is_refused_with_numbers():
    feather = replace(STILL, tool_kind="pen", tool=Tool("pen", Frame((0.0, 0.0, 0.08)), 0.001, (0.0, 0.0, 0.02)))
    with pytest.raises(PlantError, match=r"rad/s, would need \d+ sub-steps.*pad_mass"):
        Plant(feather, 0, WORK, flange(feather, 0.1))


def test_same_seed_same_run_and_another_seed_another():
    scenario = Scenario()
    forces = [settled(scenario, -0.008, 0.3, seed=seed).contact_wrench.vector() for seed in (5, 5, 6)]
    assert_allclose(forces[0], forces[1], rtol=0.0, atol=0.0)
    assert np.abs(forces[0] - forces[2]).max() > 0.1


def test_reported_pose_does_not_see_the_repeatability_error():
    plant = settled(Scenario(table=FLAT), 0.3, 2.0)
    error = plant.arm.actual[:3, 3] - plant.X_WE[:3, 3]
    assert 1e-7 < np.abs(error).max() <= 1e-4
    assert_allclose(plant.X_WE, flange(plant.scenario, 0.3), atol=1e-9)


def test_an_arm_outside_has_the_same_repeatability_error_as_the_plants_own():
    own, outside = (settled(Scenario(table=FLAT), 0.3) for _ in range(2))
    start = outside.arm.actual - outside.X_WE
    own.advance(own.time + 2.0)
    for _ in range(100):
        outside.drive(outside.X_WE, outside.time + 0.02)
    error = outside.arm.actual - outside.X_WE
    assert_allclose(error, own.arm.actual - own.X_WE, atol=1e-12)
    assert np.abs(error - start).max() > 1e-5  # [m] it wanders


def test_an_arm_outside_can_drive_the_plant():
    plant = settled(STILL, 0.3)
    target = flange(STILL, 0.29) @ make_pose(so3_exp((0.0, 0.0, 0.02)), (0.01, 0.0, 0.0))
    plant.drive(target, plant.time + 0.05)
    assert_allclose(plant.X_WE, target, atol=1e-12)
    assert np.abs(plant.X_CT[:3, 3]).max() > 1e-3  # the tool lags behind


def test_a_table_as_stiff_as_the_tools_own_points_is_refused():
    from seed_sim.scenario import load_scenario

    pen = load_scenario("pen")  # one contact point
    with pytest.raises(PlantError, match=r"contact point = 1e\+07 N/m must be less than the tool's own, 1e\+07 N/m"):
        Plant(replace(pen, table=replace(FLAT, total_stiffness=1e7)), 0, WORK, flange(pen, 0.005))
    Plant(replace(STILL, table=replace(FLAT, total_stiffness=1e7)), 0, WORK, flange(STILL, 0.005))  # five


@pytest.mark.parametrize("arm", ["cartesian", "ur5e"])
def test_a_pose_that_is_not_finite_is_refused_by_the_arm_and_the_plant_goes_on(arm):
    scenario = replace(STILL, servo=replace(EXACT, arm=arm))
    plant = Plant(scenario, 0, WORK, flange(scenario, 0.3))
    nowhere = flange(scenario, 0.3)
    nowhere[0, 3] = np.nan
    for send in (plant.command, lambda X: plant.drive(X, 0.1)):
        with pytest.raises(FailedError, match=r"'nominal': at 0\.000 s the arm is sent to a pose that is not finite"):
            send(nowhere)
    plant.advance(0.01)
    assert np.isfinite(plant.X_WT).all()


def test_reset_and_grasp_bring_the_tool_back_to_where_it_was_taken():
    plant = settled(STILL, -0.01)
    plant.grasp()
    assert_allclose(plant.X_CT, np.eye(4), atol=1e-12)
    plant.reset(flange(STILL, 0.1))
    assert plant.time == 0.0
    assert_allclose(plant.X_CT, np.eye(4), atol=1e-12)
    assert_allclose(plant.X_WE, flange(STILL, 0.1))


def test_after_a_reset_nothing_carries_the_tool():
    plant = Plant(STILL, 0, WORK, flange(STILL, 0.3))
    plant.carry(1.0)
    plant.reset(flange(STILL, 0.3))
    plant.advance(1.5)
    assert_allclose(plant.X_CT[:3, 3], (0.0, 0.0, 9.81 * 0.2 / 800.0), atol=2e-6)  # [m] its weight over the stiffness


def test_after_a_reset_the_cell_is_as_new():
    from seed_sim.scenario import load_scenario

    driver = replace(load_scenario("torque_driver"), table=FLAT, servo=EXACT)
    start, deep = flange(driver, 0.005), flange(driver, -0.004)
    new, used = (Plant(driver, 0, WORK, start) for _ in range(2))
    used.set_gripper_width(used.grip.width - 0.004)
    used.command(flange(driver, -0.006))
    used.advance(0.3)
    used.command(flange(driver, -0.006, (np.pi, 0.0, 0.3)))
    used.advance(1.0)
    assert abs(used.contact_wrench.torque[2]) > 0.1  # the screw is turned
    used.reset(start)
    assert used.grip.width == new.grip.width
    for plant in (new, used):
        plant.command(deep)
        plant.advance(0.2)
    assert_allclose(used.X_CT, new.X_CT, atol=1e-12)
    assert_allclose(used.contact_wrench.vector(), new.contact_wrench.vector(), atol=1e-9)


def test_reading_one_load_does_not_change_another():
    plant = Plant(STILL, 1, WORK, flange(STILL, 0.005))
    plant.command(flange(STILL, -0.01))
    plant.advance(0.1)  # it moves
    contact, spring = plant.contact_wrench.vector(), plant.bushing_wrench.vector()
    assert np.abs(contact).max() > 0.1
    assert_allclose(plant.ft_wrench.vector(), plant.ft_wrench.vector(), rtol=0.0)
    assert_allclose(plant.contact_wrench.vector(), contact, rtol=0.0)
    assert_allclose(plant.bushing_wrench.vector(), spring, rtol=0.0)


def test_screw_gives_way_in_proportion_to_the_torque_on_it():
    from seed_sim.plant.tools import SCREW_STIFFNESS
    from seed_sim.scenario import load_scenario

    driver = replace(load_scenario("torque_driver"), table=FLAT, servo=EXACT)
    plant = settled(driver, -0.006)
    turned = flange(driver, -0.006, (np.pi, 0.0, 0.3))
    plant.command(turned)
    plant.advance(plant.time + 1.5)
    angle = so3_log(plant.X_WT[:3, :3] @ rotation_from_rpy((np.pi, 0.0, 0.0)).T)[2]
    torque = plant.contact_wrench.torque[2]
    play = 0.0125  # [rad] of the blade in its slot
    in_series = 1.0 / (1.0 / 4.0 + 1.0 / SCREW_STIFFNESS)
    assert_allclose(torque, in_series * (0.3 - play), atol=0.03)  # [N m]; the table's friction is 0.02 of it
    assert_allclose(angle, torque / SCREW_STIFFNESS + play, atol=0.015)  # [rad]


def test_peg_is_held_by_its_hole_about_every_axis():
    from seed_sim.scenario import load_scenario

    peg = replace(load_scenario("peg"), table=FLAT, servo=EXACT)
    plant = settled(peg, -0.006)
    X = flange(peg, -0.006, (np.pi + 0.15, 0.0, 0.15))
    plant.command(X)
    plant.advance(plant.time + 1.0)
    lean = so3_log(plant.X_WT[:3, :3] @ rotation_from_rpy((np.pi, 0.0, 0.0)).T)
    assert np.abs(lean).max() < 0.08  # [rad]: twice the play of 0.3 mm on each side over 12 and 18 mm
    assert abs(plant.contact_wrench.torque[2]) > 0.2  # [N m]
