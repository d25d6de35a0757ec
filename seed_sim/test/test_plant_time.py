# SPDX-License-Identifier: Apache-2.0
"""The plant keeps the wall's time, loses what it cannot make up for, and stands still for late streams."""

import socket
import time as wall
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from seed_core.spatial import pose_from_rpy
from seed_sim.plant.plant import Plant
from seed_sim.plant.plant_time import BEHIND, PATIENCE, PlantTime
from seed_sim.plant.tool_holder import ToolHolder
from seed_sim.scenario import Scenario
from seed_ur.kinematics import URKinematics
from seed_ur.plant_link import ArmState, PlantLink
from seed_ur.standin.options import RTDE_PORT
from seed_ur.standin_client import StandIn as StandInProcess

PERIOD = 0.004  # [s]
ROS = 1000.0  # [s] ROS time at the start
STEADY = 50.0  # [s] the machine's clock then
BENT = np.array((0.3, -1.5, 2.0, -2.0, -np.pi / 2, 0.2))  # [rad] another place than the stand-in's own start
HOME = pose_from_rpy((np.pi, 0.0, 0.0), (0.45, 0.0, 0.5))


def started(clock: bool) -> tuple[Plant, PlantTime]:
    plant = Plant(Scenario(), 0, np.eye(4), HOME)
    return plant, PlantTime(plant, ToolHolder(plant), None, clock, STEADY, ROS)


class Heard:
    """The link to a stand-in controller whose clock began somewhere, heard from `first` on [s]."""

    def __init__(self, first: float) -> None:
        self.first, self.passed = first, 0.0
        self.clock = None

    def receive(self) -> ArmState | None:
        if self.passed < self.first:
            return None
        return ArmState(7.0 + self.passed, HOME, np.zeros(6), np.zeros(6))

    def report(self, *_: object) -> None:
        pass


def test_behind_a_stand_in_that_is_heard_late_the_state_is_dated_when_it_is() -> None:
    plant = Plant(Scenario(), 0, np.eye(4), HOME)
    link = Heard(first=0.12)
    time = PlantTime(plant, ToolHolder(plant), cast(PlantLink, link), False, STEADY, ROS)
    for i in range(1, 101):
        link.passed = i * PERIOD
        time.advance(STEADY + link.passed, PERIOD)
    assert plant.time == pytest.approx(0.4 - 0.12, abs=2 * PERIOD)
    assert time.stamp == pytest.approx(ROS + 0.4, abs=PERIOD)


def restart(robot: StandInProcess) -> None:
    robot.kill()
    robot.start()


def set_back(robot: StandInProcess) -> None:
    robot.ask("set_clock_back", seconds=5.0)


@pytest.mark.realtime
@pytest.mark.parametrize("clock", [False, True])
@pytest.mark.parametrize("change", [restart, set_back])
def test_the_plant_goes_on_beside_a_stand_in_that_began_anew(
    change: Callable[[StandInProcess], None], clock: bool
) -> None:
    """Its ports are open again, and its arm is where the plant's flange was, which makes no jump."""
    start = URKinematics.for_model("ur5e").forward(BENT)
    plant = Plant(Scenario(), 0, np.eye(4), start)
    with StandInProcess(None, "--await-plant") as robot, PlantLink(robot.host) as link:
        link.place(start, BENT, ROS if clock else None, stay=not clock)
        time = PlantTime(plant, ToolHolder(plant), link, clock, wall.monotonic(), ROS)

        def run(seconds: float) -> tuple[float, list[str]]:
            """How far the plant got in so many seconds [s], and what was told."""
            before, until, told = plant.time, wall.monotonic() + seconds, []
            while wall.monotonic() < until:
                told.append(time.advance(wall.monotonic(), PERIOD))
                assert np.abs(plant.X_WE - start).max() < 1e-6
                wall.sleep(PERIOD)
            return plant.time - before, [t for t in told if t]

        went, told = run(1.0)
        assert went > 0.5
        assert not told
        change(robot)
        went, told = run(1.0)
        assert went > 0.5
        assert len(told) == 1
        assert told[0].startswith("the clock of the stand-in controller went back by ")
        assert told[0].endswith(" s: the plant goes on from where it was")
        socket.create_connection((robot.host, RTDE_PORT), timeout=1.0).close()


@pytest.mark.parametrize("clock", [False, True])
def test_the_plant_keeps_the_walls_time_and_stamps_its_state_in_ros_time(clock: bool) -> None:
    plant, time = started(clock)
    for i in range(1, 51):
        time.advance(STEADY + i * PERIOD, PERIOD)
    assert plant.time == pytest.approx(50 * PERIOD, abs=PERIOD)
    assert time.stamp == pytest.approx(ROS + plant.time)
    assert time.measure(STEADY + 50 * PERIOD)
    assert time.factor == pytest.approx(1.0, abs=0.02)
    assert time.lost == pytest.approx(0.0)


def test_time_in_which_the_machine_was_busy_is_lost_and_known_to_ros_alone() -> None:
    for clock in (False, True):
        plant, time = started(clock)
        time.advance(STEADY + 1.0, PERIOD)  # a second without a call
        assert plant.time == pytest.approx(BEHIND, abs=PERIOD)
        assert time.lost == pytest.approx(1.0 - BEHIND)
        # by the wall's clock the plant's state is of now; by its own clock nobody knows of the second
        assert time.stamp == pytest.approx(ROS + (BEHIND if clock else 1.0), abs=PERIOD)


def test_the_plant_stands_still_for_a_late_target_only_if_its_time_is_everybodys() -> None:
    for clock in (False, True):
        plant, time = started(clock)
        time.streams["target_frame"].hear(time.stamp)
        for i in range(1, 101):
            time.advance(STEADY + i * PERIOD, PERIOD)
        if clock:
            assert plant.time == pytest.approx(PATIENCE["target_frame"], abs=2 * PERIOD)
            time.streams["target_frame"].hear(time.stamp)
            before = plant.time
            time.advance(STEADY + 101 * PERIOD, PERIOD)
            assert plant.time > before
        else:
            assert plant.time == pytest.approx(100 * PERIOD, abs=PERIOD)
