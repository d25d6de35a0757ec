# SPDX-License-Identifier: Apache-2.0
"""Programs and the dashboard's sentences, without sockets."""

import pytest

from seed_ur.standin import dashboard
from seed_ur.standin.controller import Controller
from seed_ur.standin.options import STOPPED, Options
from seed_ur.standin.script import Script

DT = 0.002


@pytest.mark.parametrize("end", [Controller.protective_stop, lambda robot: dashboard.answer(robot, "stop")])
def test_a_program_that_was_stopped_before_it_began_does_not_begin(end) -> None:
    robot = Controller(Options())
    robot.tick(0.0)
    assert not robot.upload(Script(robot, "def f():\nend"), 0.0)
    end(robot)
    for i in range(100):
        robot.tick(DT * i)
        assert robot.program is None
        assert robot.runtime_state == STOPPED


@pytest.mark.parametrize(
    ("line", "pattern"),
    [
        ("PolyscopeVersion", "URSoftware 5.12.4.1101319"),
        ("get serial number", "20215500001"),
        ("is in remote control", "true"),
        ("stop", "Stopped"),
        ("robotmode", "Robotmode: RUNNING"),
        ("safetystatus", "Safetystatus: NORMAL"),
        ("load a.urp", "Loading program: a.urp"),
        ("what", "could not understand: 'what'"),
    ],
)
def test_the_dashboard_answers_literally(line: str, pattern: str) -> None:
    assert pattern in dashboard.answer(Controller(Options()), line)


def test_old_software_does_not_know_newer_dashboard_commands() -> None:
    robot = Controller(Options(version=(5, 4, 2, 1)))
    assert "could not understand" in dashboard.answer(robot, "is in remote control")
