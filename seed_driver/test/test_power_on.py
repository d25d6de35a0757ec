# SPDX-License-Identifier: Apache-2.0
"""Power is refused by name where the robot takes none, whatever its dashboard acknowledges."""

import pytest

from seed_driver.robot import recovery, robot_api
from seed_driver.robot.dashboard import NoDashboardError
from seed_driver.robot.link import LinkError
from seed_driver.robot.recovery import power_on

HOST = "127.0.77.6"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch):
    """What a dashboard that acknowledges everything was asked for; its safety mode is the attribute of this name."""

    class Asked(list[str]):
        safety = "NORMAL"

        def __call__(self, host: str, *commands: str) -> str:
            assert host == HOST
            self.extend(commands)
            return f"Safetystatus: {self.safety}" if commands == ("safetystatus",) else "Brake releasing"

    made = Asked()
    monkeypatch.setattr(recovery, "dashboard", made)
    monkeypatch.setattr(robot_api, "dashboard", made)
    return made


@pytest.mark.parametrize(
    ("safety", "words"),
    [
        ("ROBOT_EMERGENCY_STOP", "in robot emergency stop: release the button, then call power_on"),
        ("SYSTEM_EMERGENCY_STOP", "in system emergency stop: release the button"),
        ("FAULT", "in fault: call restart_safety, then call power_on"),
        ("VIOLATION", "in violation: call restart_safety"),
    ],
)
def test_a_robot_that_takes_no_power_is_not_asked_to(asked, safety: str, words: str) -> None:
    asked.safety = safety
    with pytest.raises(LinkError, match=words):
        power_on(HOST)
    assert asked == ["safetystatus"]


@pytest.mark.parametrize("safety", ["NORMAL", "REDUCED", "SAFEGUARD_STOP", "PROTECTIVE_STOP"])
def test_any_other_is(asked, safety: str) -> None:
    asked.safety = safety
    assert power_on(HOST) == "Brake releasing"
    assert asked[1:] == ["power on", "brake release"]


def test_without_a_dashboard_the_robot_api_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(*_: str) -> str:
        raise NoDashboardError("no dashboard")

    monkeypatch.setattr(recovery, "dashboard", nobody)
    monkeypatch.setattr(recovery, "switch", lambda *_, **__: "POWER_ON, BRAKE_RELEASE: accepted by the Robot API")
    assert "accepted by the Robot API" in power_on(HOST)
