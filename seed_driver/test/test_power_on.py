# SPDX-License-Identifier: Apache-2.0
"""What a robot's safety mode does not ask for is refused by name, whatever its dashboard acknowledges."""

import pytest

from seed_driver.power import recovery, robot_api
from seed_driver.power.recovery import power_on, restart_safety, unlock
from seed_driver.robot.dashboard import NoDashboardError
from seed_driver.robot.link import LinkError

HOST = "127.0.77.6"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch):
    """What a dashboard that acknowledges everything was asked for; its safety mode is the attribute of this name."""

    class Asked(list[str]):
        safety = "NORMAL"

        def __call__(self, host: str, *commands: str) -> str:
            assert host == HOST
            self.extend(commands)
            if commands == ("safetystatus",):
                return f"Safetystatus: {self.safety}"
            return "Restarting safety" if commands[-1] == "restart safety" else "Brake releasing"

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


@pytest.mark.parametrize(
    ("safety", "words"),
    [
        ("NORMAL", "the safety system is NORMAL: nothing to restart$"),
        ("REDUCED", "REDUCED: nothing to restart$"),
        ("PROTECTIVE_STOP", "PROTECTIVE_STOP: nothing to restart; call unlock_protective_stop"),
        ("ROBOT_EMERGENCY_STOP", "nothing to restart; release the button"),
        ("", "nothing to restart$"),
    ],
)
def test_a_safety_system_that_is_well_is_not_restarted_for_that_takes_the_power_away(
    asked, safety: str, words: str
) -> None:
    asked.safety = safety
    with pytest.raises(LinkError, match=words):
        restart_safety(HOST)
    assert "restart safety" not in asked


@pytest.mark.parametrize("safety", ["VIOLATION", "FAULT"])
def test_after_a_violation_or_fault_it_is(asked, safety: str) -> None:
    asked.safety = safety
    assert restart_safety(HOST) == "Restarting safety; then call power_on"


@pytest.mark.parametrize(
    ("safety", "words"),
    [
        ("NORMAL", "the safety system is NORMAL: nothing to unlock$"),
        ("FAULT", "FAULT: nothing to unlock; call restart_safety"),
        ("SAFEGUARD_STOP", "SAFEGUARD_STOP: nothing to unlock$"),
    ],
)
def test_what_is_no_protective_stop_is_not_unlocked(asked, safety: str, words: str) -> None:
    asked.safety = safety
    with pytest.raises(LinkError, match=words):
        unlock(HOST)
    assert "unlock protective stop" not in asked


def test_a_protective_stop_is_unlocked(asked) -> None:
    asked.safety = "PROTECTIVE_STOP"
    assert unlock(HOST) == "Brake releasing"
    assert asked[-1] == "unlock protective stop"


def test_without_a_dashboard_what_the_link_tells_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(*_: str) -> str:
        raise NoDashboardError("no dashboard")

    monkeypatch.setattr(recovery, "dashboard", nobody)
    monkeypatch.setattr(recovery, "switch", lambda *_, **__: "accepted by the Robot API")
    for call in (restart_safety, unlock):
        with pytest.raises(LinkError, match="the safety system is NORMAL: nothing to"):
            call(HOST, 1)
    assert "accepted" in unlock(HOST, 3)
    for fault in (8, 9):
        assert "accepted" in restart_safety(HOST, fault)
