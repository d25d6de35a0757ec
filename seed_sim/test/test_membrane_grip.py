# SPDX-License-Identifier: Apache-2.0
"""A tool between membranes in the plant: statics, friction that remembers, pressures, images of the same solve."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.spatial import Wrench, inverse_pose, make_pose, pose_from_rpy, so3_exp
from seed_sim.bubble_renderer import HeldRenderer, renderer_of
from seed_sim.membrane import MembraneError, MembraneGrasp, MembraneParameters
from seed_sim.membrane.hold import MembraneHold
from seed_sim.plant.grip import PlantError
from seed_sim.plant.plant import Plant
from seed_sim.plant.tool_holder import ToolHolder
from seed_sim.pressure import PressureSensors
from seed_sim.scenario import (
    GraspSection,
    PressureSection,
    Scenario,
    ServoSection,
    TableSection,
    on_membrane,
    tactile_of,
)
from seed_sim.tactile import TactileParameters, TactileRenderer
from seed_sim.tactile.parameters import HANDLE

FLAT = TableSection(tilt_x=(0.0, 0.0), tilt_y=(0.0, 0.0), height=(0.0, 0.0))
COARSE = MembraneParameters(spacing=0.008, squeeze=0.0125)
SCENARIO = Scenario(
    table=FLAT,
    servo=ServoSection(repeatability=0.0),
    grasp=GraspSection(kind="membrane"),
    membrane=COARSE,
    tactile=TactileParameters(tool=HANDLE),
)
WORK = make_pose(None, (0.45, 0.0, 0.0))
WEIGHT = 9.81 * 0.2  # [N]


def flange(height: float) -> np.ndarray:
    """X_WE (4, 4) with the undeflected tip `height` above the work frame's origin."""
    X_W_tip = WORK @ pose_from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, height))
    return X_W_tip @ inverse_pose(SCENARIO.tool.X_Ttip) @ inverse_pose(SCENARIO.hand.X_EC)


def let_down(plant: Plant) -> None:
    """Give the tool's weight to the grasp gently."""
    for i in range(50):
        plant.carry(1.0 - i / 49)
        plant.advance(plant.time + 0.01)
    plant.advance(plant.time + 0.3)


@pytest.fixture(scope="module")
def hanging() -> Plant:
    plant = Plant(SCENARIO, 0, WORK, flange(0.3))
    let_down(plant)
    return plant


def test_hanging_tool_is_carried_where_the_membranes_alone_would_carry_it(hanging):
    carried = hanging.X_WT[:3, :3] @ hanging.bushing_wrench.force
    assert_allclose(carried, (0.0, 0.0, WEIGHT), atol=2e-3)  # [N]
    X_CT = MembraneHold(COARSE, HANDLE).under(Wrench(np.zeros(3), np.array((0.0, 0.0, WEIGHT))))
    assert_allclose(hanging.X_CT[:3, 3], X_CT[:3, 3], atol=3e-5)  # [m]; the plant went there along a path of its own
    assert hanging.X_CT[2, 3] > 3e-4


def test_wrist_sensor_reads_the_weight_through_the_membranes(hanging):
    R_WE = hanging.arm.actual[:3, :3]
    assert_allclose(R_WE @ hanging.ft_wrench.force, (0.0, 0.0, -WEIGHT), atol=2e-3)


def test_pressed_tool_is_in_balance_and_its_solve_is_what_the_plant_feels():
    plant = Plant(SCENARIO, 0, WORK, flange(0.003))
    let_down(plant)
    while plant.time < 2.0:
        plant.command(flange(max(0.003 - 0.02 * (plant.time - 0.8), -0.003)))
        plant.advance(plant.time + 0.004)
    pressed = -plant.contact_wrench.force[2]
    assert 4.0 < pressed < 12.0  # [N]
    assert_allclose(plant.X_WT[2, :3] @ plant.bushing_wrench.force, WEIGHT - pressed, atol=0.02)
    plant.solve_membranes()
    hold = plant.membranes
    assert_allclose(hold.state.X_CT, plant.X_CT)
    assert_allclose(hold.state.wrench.vector(), plant.bushing_wrench.vector(), atol=0.02)
    assert hold.unsettled == 0


def test_friction_remembers_where_the_tool_has_been():
    """Down and up by the same way, and the load is another: a bushing forgets."""
    hold = MembraneHold(replace(COARSE, friction=0.6, squeeze=0.007), HANDLE)
    way = [0.0005 * i for i in range(1, 9)]
    for z in way:
        hold.at(make_pose(None, (0.0, 0.0, z)), 0.0)
    for z in way[-2:2:-1]:
        hold.at(make_pose(None, (0.0, 0.0, z)), 0.0)
    back = hold.state.wrench.force[2]
    assert hold.most_sliding > 0.2
    hold.restart()
    assert (hold.solves, hold.unsettled, hold.most_sliding) == (0, 0, 0.0)  # of the grasp that is over
    for z in way[:4]:
        there = hold.at(make_pose(None, (0.0, 0.0, z)), 0.0)
    assert_allclose(there.X_CT[2, 3], 0.002)
    assert abs(back - there.wrench.force[2]) > 0.1  # [N]
    assert hold.most_sliding > 0.2


def test_a_grasp_that_is_taken_late_creeps_from_then_on():
    """Not by all the time before, at its first solve: 0.05 s after the grasp the gas is as after a grasp at 0 s."""
    creeping = replace(SCENARIO, membrane=replace(COARSE, creep=0.2, creep_time=0.5))
    plant = Plant(creeping, 0, WORK, flange(0.3))
    told = []
    for start in (0.0, 2.0):
        plant.advance(start)
        plant.carry(1.0)
        plant.grasp()
        closed = plant.grip.pressure
        plant.advance(start + 0.05)
        soon = plant.grip.pressure
        plant.advance(start + 2.0)
        told.append((soon - closed, plant.grip.pressure - closed))
    assert_allclose(told[1], told[0], atol=1e-3)  # [hPa]
    soon, late = told[0]
    assert abs(soon) < 0.3 * abs(late)
    assert abs(late) > 0.05


def test_between_solves_the_load_follows_the_tangent():
    plant = Plant(SCENARIO, 0, WORK, flange(0.3))
    grip = plant.grip
    X_TC = make_pose(so3_exp((0.002, -0.003, 0.001)), (1e-4, -5e-5, 2e-4))
    still = np.zeros(6)
    linear = grip.wrench(X_TC, still, 0.001).vector()
    grasp = MembraneGrasp(COARSE, HANDLE)
    grasp.close()
    solved = grasp.solve(inverse_pose(X_TC)).wrench.vector()
    assert_allclose(linear, solved, atol=0.03)  # of 0.02 N m and 0.6 N: friction lets some nodes go
    assert np.abs(linear[3:]).max() > 0.3
    moving = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.1))
    damped = grip.wrench(X_TC, moving, 0.001).vector() - linear
    assert_allclose(damped[5], 0.1 * grip.damping[1][2])
    assert damped[5] > 0.0  # the tool is dragged along


def test_firmer_grip_raises_pressure_and_stiffness_and_a_loose_one_is_refused():
    wide = replace(SCENARIO, grasp=replace(SCENARIO.grasp, nominal_width=0.06))
    plant = Plant(wide, 0, WORK, flange(0.3))
    before, stiffness = plant.grip.pressure, plant.stiffness.vector()
    assert_allclose(before, 0.01 * COARSE.ambient + 50.0, atol=30.0)  # [hPa]
    plant.set_gripper_width(0.057)
    assert plant.grip.pressure > before + 1.0
    assert (plant.stiffness.vector()[3:] > stiffness[3:]).all()
    width = plant.grip.width
    with pytest.raises(PlantError, match=r"loose: at most 0\.0850 m"):
        plant.set_gripper_width(0.09)
    with pytest.raises(PlantError, match="pierces"):
        plant.set_gripper_width(0.0)
    assert plant.grip.width == width
    plant.reset(flange(0.3))
    assert_allclose(plant.grip.pressure, before)


def test_push_is_foretold_between_solves_by_the_membranes_own_rise():
    """Over half a millimetre each way within 15 %: the tangent is of places that touch already, others come and go."""
    grip = Plant(SCENARIO, 0, WORK, flange(0.3)).grip
    width, before = grip.width, grip.push
    for way in (-0.0005, 0.0005):
        foretold = grip.push_at(width + way)
        grip.set_width(width + way)
        assert abs(grip.push - before) > 0.5  # [N]
        assert_allclose(foretold - before, grip.push - before, rtol=0.15)
        grip.set_width(width)
    assert grip.push_at(width + 0.1) == 0.0  # fingers do not pull


def test_holder_carries_the_tool_between_membranes_until_the_arm_moves():
    plant = Plant(SCENARIO, 0, WORK, flange(0.3))
    holder = ToolHolder(plant)
    holder.grasp()
    holder.advance(0.3)
    assert holder.carries
    assert_allclose(plant.X_CT, np.eye(4), atol=3e-5)
    start = plant.time
    while plant.time < start + 1.2:
        X = flange(0.3)
        X[2, 3] += min(0.005, 0.02 * (plant.time - start))
        plant.command(X)
        holder.advance(plant.time + 0.004)
    assert not holder.carries
    assert_allclose(plant.X_WT[2, :3] @ plant.bushing_wrench.force, WEIGHT, atol=0.02)


def test_images_show_the_solve_that_the_plant_feels(hanging):
    renderer = renderer_of(SCENARIO, 4, hanging.membranes)
    assert isinstance(renderer, HeldRenderer)
    hanging.solve_membranes()
    solves = hanging.membranes.solves
    images = renderer.render(hanging.X_CT, hanging.time)
    assert hanging.membranes.solves == solves  # the same pose at the same time: the same state
    free = renderer.no_contact(hanging.time)
    for finger, state in hanging.membranes.state.bubbles.items():
        inner = np.s_[50:120, 60:160]
        imprint = np.nanmax((free[finger].depth - images[finger].depth)[inner])
        assert_allclose(imprint, COARSE.squeeze, atol=0.004)  # [m]; noise on top
        nodes = state.nodes[state.touching] @ hanging.X_CT[:3, :3] - hanging.X_CT[:3, 3]
        assert_allclose(
            np.abs(nodes[:, 1]), HANDLE.radius, atol=6e-4
        )  # on the handle's sides, and in it by the penalty


def test_a_bushing_has_the_renderer_that_it_had():
    assert isinstance(renderer_of(Scenario(), 0), TactileRenderer)


def test_random_membranes_differ_and_come_again():
    one, other = on_membrane(Scenario(), 3, firm=True), on_membrane(Scenario(), 4, firm=True)
    assert one == on_membrane(Scenario(), 3, firm=True)
    assert one.membrane != other.membrane
    assert tactile_of(one).dot_pitch != tactile_of(other).dot_pitch
    assert one.grasp.kind == "membrane"
    assert 0.0 < on_membrane(Scenario(), 3).membrane.squeeze < one.membrane.squeeze


def test_load_that_friction_does_not_bear_is_refused():
    hold = MembraneHold(replace(COARSE, friction=0.3, squeeze=0.005), HANDLE)
    with pytest.raises(MembraneError, match="do not bear"):
        hold.under(Wrench(np.zeros(3), np.array((0.0, 0.0, 30.0))))


def test_a_tool_counts_as_torn_out_by_time_not_by_how_often_one_looks(monkeypatch):
    hold = MembraneHold(COARSE, HANDLE)
    kept = hold.state._replace(converged=False)
    monkeypatch.setattr(hold._grasp, "solve", lambda *_: kept)
    for i in range(1, 500):  # the plant looks every millisecond while the tool moves fast
        hold.at(make_pose(None, (0.0, 0.0, 1e-6 * i)), 1e-3 * i)
    with pytest.raises(MembraneError, match=r"for 0\.5. s: the tool is torn out"):
        hold.at(np.eye(4), 0.51)


def test_tool_with_hardly_any_inertia_is_refused_with_numbers():
    feather = replace(SCENARIO, tool=replace(SCENARIO.tool, mass=1e-4))
    with pytest.raises(PlantError, match=r"rad/s, would need\s+\d+ sub-steps.*pad_mass"):
        Plant(feather, 0, WORK, flange(0.3))


@pytest.mark.parametrize(
    ("fault", "left", "right"),
    [
        ("none", 1050.0, 1051.0),
        ("silent", None, None),
        ("left_silent", None, 1051.0),
        ("stuck", 1040.0, 1041.0),
        ("left_stuck", 1040.0, 1051.0),
        ("pascal", 105000.0, 105100.0),
        ("gauge", 36.75, 37.75),
    ],
)
def test_pressure_sensors_fail_as_they_are_told(fault, left, right):
    sensors = PressureSensors(Scenario(pressure=PressureSection(fault=fault, fault_from=1.0)), 0)
    assert sensors.read({"left": 1040.0, "right": 1041.0}, 0.5) == {"left": 1040.0, "right": 1041.0}
    told = sensors.read({"left": 1050.0, "right": 1051.0}, 1.5)
    expected = {name: value for name, value in (("left", left), ("right", right)) if value is not None}
    assert told == pytest.approx(expected)


def test_sensor_noise_is_as_large_as_it_says():
    sensors = PressureSensors(Scenario(pressure=PressureSection(noise=0.05, offset=2.0)), 3)
    told = [sensors.read({"left": 1040.0, "right": 1040.0}, 0.01 * i)["right"] for i in range(400)]
    assert_allclose(np.mean(told), 1042.0, atol=0.02)
    assert_allclose(np.std(told), 0.05, rtol=0.15)
