# SPDX-License-Identifier: Apache-2.0
"""From a stop to an arm that can move: each step waits for the mode that it is to reach. Nothing moves by it.

Source: Universal Robots, "Dashboard Server e-Series"; the order is that of UR's robot_state_helper.
"""

import time
from collections.abc import Callable

from seed_driver.power.robot_api import switch
from seed_driver.robot.dashboard import LOCAL_CONTROL, LateError, NoDashboardError, dashboard
from seed_driver.robot.link import LinkError

Ask = Callable[..., str]  # dashboard commands in turn; the last answer
Pause = Callable[[float], None]
LOOK = 0.1  # [s] between two looks
FREE = ("NORMAL", "REDUCED")
LOCKED = 10.0  # [s] UR refuses to unlock a protective stop within 5 s
RESTARTING = 40.0  # [s] of the safety system
MODES = {"POWER_OFF": "power on", "POWER_ON": "", "BOOTING": "", "IDLE": "brake release"}  # what leads out of each
SWITCHING = 20.0  # [s] of each of these modes
POWERLESS = {  # safety modes in which a robot takes no power, though its dashboard may say otherwise; what ends them
    "ROBOT_EMERGENCY_STOP": "release the button",
    "SYSTEM_EMERGENCY_STOP": "release the button",
    "VIOLATION": "call restart_safety",
    "FAULT": "call restart_safety",
}
ENDED_BY = POWERLESS | {"PROTECTIVE_STOP": "call unlock_protective_stop"}
MODES_OF_RTDE = {  # the dashboard's names of RTDE's safety_mode
    1: "NORMAL",
    2: "REDUCED",
    3: "PROTECTIVE_STOP",
    4: "RECOVERY",
    5: "SAFEGUARD_STOP",
    6: "SYSTEM_EMERGENCY_STOP",
    7: "ROBOT_EMERGENCY_STOP",
    8: "VIOLATION",
    9: "FAULT",
}
REMEDIES = {
    "PROTECTIVE_STOP": ("unlock protective stop", LOCKED),
    "VIOLATION": ("restart safety", RESTARTING),
    "FAULT": ("restart safety", RESTARTING),
}


def recover(host: str, pause: Pause = time.sleep) -> str:
    """Unlock, restart the safety system, power on, release the brakes: what is needed of these.

    Args:
        pause: between two looks [s]; a LinkError of it ends the waiting.

    Returns:
        What to do next.

    Raises:
        LinkError: nobody answers, a mode was not reached in its time, or a person has to act.
    """

    def ask(*commands: str) -> str:
        return dashboard(host, *commands)

    steps = [*_make_safe(ask, pause), *_switch_on(ask, pause)]
    return f"{', '.join(steps) or 'nothing was to be done'}; {local_control(host) or 'call resend_robot_program'}"


def local_control(host: str) -> str:
    """That the robot takes no program in local control, and what to do; '' unless its dashboard says that it is."""
    try:
        local = "false" in dashboard(host, "is in remote control").lower()
    except (LateError, NoDashboardError):
        return ""
    return f"the robot is {LOCAL_CONTROL}, then call resend_robot_program" if local else ""


def power_on(host: str, pause: Pause = time.sleep) -> str:
    """Power on and brake release; what was accepted. Raises LinkError with what is in the way."""
    try:
        safety = _safety(lambda *commands: dashboard(host, *commands))
    except NoDashboardError:  # PolyScope X: its Robot API refuses by itself
        safety = ""
    if safety in POWERLESS:
        raise LinkError(f"the robot is in {_words(safety)}: {POWERLESS[safety]}, then call power_on")
    return switch(host, "power on", "brake release", said="releasing", pause=pause)


def unlock(host: str, safety_mode: int = 0, pause: Pause = time.sleep) -> str:
    """End a protective stop; what was accepted.

    Args:
        safety_mode: that the robot told last, by RTDE; 0: none.
        pause: as in `recover`.

    Raises:
        LinkError: there is none, or it is not unlocked yet.
    """
    _require(host, safety_mode, "unlock", "PROTECTIVE_STOP")
    return switch(host, "close safety popup", "unlock protective stop", said="releasing", pause=pause)


def restart_safety(host: str, safety_mode: int = 0, pause: Pause = time.sleep) -> str:
    """After a violation or fault of the safety system; the arm is without power then.

    Args:
        safety_mode: that the robot told last, by RTDE; 0: none.
        pause: as in `recover`.

    Raises:
        LinkError: there is neither, for that would take an arm's power away, or it is refused.
    """
    _require(host, safety_mode, "restart", "VIOLATION", "FAULT")
    try:
        answer = switch(host, "close safety popup", "restart safety", said="restarting safety", pause=pause)
    except LinkError as error:
        raise LinkError(f"the safety system is not restarted: {error}") from error
    return f"{answer}; then call power_on"


def _require(host: str, safety_mode: int, what: str, *modes: str) -> None:
    """Raise LinkError unless the safety system is in one of these modes, or nobody tells its mode."""
    try:
        safety = _safety(lambda *commands: dashboard(host, *commands))
    except NoDashboardError:  # PolyScope X: what the link tells
        safety = MODES_OF_RTDE.get(safety_mode, "")
        if not safety:
            return
    if safety not in modes:
        remedy = f"; {ENDED_BY[safety]}" if safety in ENDED_BY else ""
        raise LinkError(f"the safety system is {safety}: nothing to {what}{remedy}")


def _make_safe(ask: Ask, pause: Pause) -> list[str]:
    safety = _safety(ask)
    if safety in FREE:
        return []
    if safety not in REMEDIES:
        raise LinkError(f"the robot is in {_words(safety)}: only a person at the arm can end that")
    command, within = REMEDIES[safety]
    until, said = time.monotonic() + within, ""
    accepted = False
    while _safety(ask) not in FREE:
        if time.monotonic() > until:
            raise LinkError(f"the robot is still in {_words(safety)} {within:g} s after '{command}': {said}")
        if not accepted:
            said = ask("close safety popup", command)
            accepted = command == "restart safety" or "releasing" in said.lower()
        pause(LOOK)
    return [f"{_words(safety)} ended"]


def _switch_on(ask: Ask, pause: Pause) -> list[str]:
    steps: list[str] = []
    while (mode := _mode(ask)) != "RUNNING":
        if mode not in MODES:
            raise LinkError(f"the robot is in mode {_words(mode)}: look at the pendant")
        said = ask(MODES[mode]) if MODES[mode] else "it is on its way"
        until = time.monotonic() + SWITCHING
        while _mode(ask) == mode:
            if time.monotonic() > until:
                raise LinkError(f"the robot is still in mode {_words(mode)} after {SWITCHING:g} s: {said}")
            pause(LOOK)
        if MODES[mode]:
            steps.append(MODES[mode])
    return steps


def _safety(ask: Ask) -> str:
    answer = ask("safetystatus")
    if ":" not in answer or "understand" in answer:  # PolyScope 3
        answer = ask("safetymode")
    return _value(answer)


def _mode(ask: Ask) -> str:
    return _value(ask("robotmode"))


def _value(answer: str) -> str:
    return answer.rpartition(":")[2].strip().upper()


def _words(name: str) -> str:
    return name.lower().replace("_", " ")
