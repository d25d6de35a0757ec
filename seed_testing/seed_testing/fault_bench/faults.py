# SPDX-License-Identifier: Apache-2.0
"""The faults that the driver is tested with: what is done to it, how it is undone, how soon it must be reported."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from seed_core.errors import SeedError
from seed_driver.robot.probe import LinkError, dashboard
from seed_testing.fault_bench.bench import Rig

AT_REST = 2e-3  # [m/s]
REST_WITHIN = 0.6  # [s] after a fault: watchdog (0.1 s), braking from 0.04 m/s, servo lag, and a margin
JUMP = 1e-3  # [m] that the arm may move on recovery, without a target


class Fault(NamedTuple):
    """One fault; `hurt` does it, `heal` undoes it (the controller is back when it returns)."""

    name: str
    hurt: Callable[[Rig], object]
    heal: Callable[[Rig], object]
    report_within: float = 0.1  # [s]
    asleep: float = 0.0  # [s] that the controller itself, arm included, stands still as in a photograph


class Outcome(NamedTuple):
    """What happened."""

    report: float  # [s] from the fault to the driver's saying so
    recovery: float  # [s] from the controller's return to following targets again
    coast: float  # [m] travelled after the fault
    jump: float  # [m] moved on recovery without a target


def _nothing(_: Rig) -> None:
    return None


def _restart(rig: Rig) -> None:
    rig.robot.kill()
    rig.robot.start()


def _unlock(rig: Rig) -> None:
    _insist(rig, "releasing", "close safety popup", "unlock protective stop")


def _power_up(rig: Rig) -> None:
    rig.robot.ask("release_emergency_stop")
    _insist(rig, "releasing", "power on", "brake release")


def _insist(rig: Rig, answer: str, *commands: str) -> None:
    """Dashboard commands until the last is answered so: the stop may be locked, the dashboard be away for a while."""
    until, said = time.monotonic() + 8.0, ""
    while answer not in said.lower():
        if time.monotonic() > until:
            raise SeedError(f"the stand-in does not answer '{commands[-1]}' with '{answer}' but with '{said}'")
        try:
            said = dashboard(rig.robot.host, *commands)
        except LinkError as error:
            said = str(error)
        rig.run(0.1)


def _do(action: str, **arguments: object) -> Callable[[Rig], object]:
    return lambda rig: rig.robot.ask(action, **arguments)


def _wait(seconds: float) -> Callable[[Rig], None]:
    return lambda rig: rig.run(seconds)


def _stop_as(program: str) -> Callable[[Rig], object]:
    def hurt(rig: Rig) -> None:
        rig.robot.ask("option", name="program_on_stop", value=program)
        rig.robot.ask("protective_stop")

    return hurt


def _signal(number: int) -> Callable[[Rig], object]:
    def hurt(rig: Rig) -> None:
        if rig.supervisor.pid is not None:
            os.kill(rig.supervisor.pid, number)

    return hurt


def _ready_again(rig: Rig) -> None:
    rig.robot.ask("switch", name="stuck_ready", on=False)
    rig.run(0.2)


FAULTS = (
    Fault("controller killed", lambda rig: rig.robot.kill(), lambda rig: rig.robot.start()),
    Fault("controller frozen 1 s", _do("freeze", seconds=1.0), _wait(0.2), 0.2, 1.0),
    Fault("controller frozen 4 s", _do("freeze", seconds=4.0), _wait(0.2), 0.2, 4.0),
    Fault("outputs paused 0.3 s", _do("pause_outputs", seconds=0.3), _wait(0.5), 0.2),
    Fault("outputs paused 3 s", _do("pause_outputs", seconds=3.0), _wait(3.1), 0.2),
    Fault("network silent 1 s", _do("silence", seconds=1.0), _wait(1.1), 0.2),
    Fault("RTDE connections dropped", _do("drop_rtde"), _nothing),
    Fault("all connections dropped", _do("drop_all"), _nothing),
    Fault("connections refused 1 s", _do("refuse", seconds=1.0), _wait(1.1)),
    Fault("protective stop, program paused", _stop_as("paused"), _unlock),
    Fault("protective stop, program stopped", _stop_as("stopped"), _unlock),
    Fault("protective stop, program playing", _stop_as("playing"), _unlock),
    Fault("emergency stop", _do("emergency_stop"), _power_up),
    Fault("program stopped on the pendant", _do("pendant_stop"), _nothing),
    Fault("ready bit stuck", _do("switch", name="stuck_ready"), _ready_again),
    Fault("servo process killed", _signal(signal.SIGKILL), _nothing),
    Fault("servo process crashes", _signal(signal.SIGSEGV), _nothing),
    Fault("servo process stopped", _signal(signal.SIGSTOP), _wait(0.7)),
)


def suffer(rig: Rig, fault: Fault, moving: float = 0.5) -> Outcome:
    """Move, let the fault happen, check that the arm rests, heal, recover, check that nothing jumps.

    Raises SeedError when the arm does not come to rest, jumps, or does not recover.
    """
    rig.ready()
    rig.sway()
    rig.run(moving)
    start = time.monotonic()
    fault.hurt(rig)
    rig.wait(lambda s: not s.armed, 5.0, f"report of '{fault.name}'")
    report = rig.first_report(start)
    rig.run(fault.asleep + REST_WITHIN)
    coast = _coast(rig, fault, start)
    fault.heal(rig)
    rig.still()
    back = time.monotonic()
    place = _place(rig)
    rig.recover()
    recovery = time.monotonic() - back
    rig.run(0.2)
    jump = float(np.linalg.norm(np.subtract(_place(rig), place)))
    if jump > JUMP:
        raise SeedError(f"{fault.name}: the arm jumped {jump:.4f} m on recovery, limit {JUMP} m")
    return Outcome(report, recovery, coast, jump)


def _coast(rig: Rig, fault: Fault, start: float) -> float:
    """Travel since the fault; the arm has to rest by now. A dead controller has no arm to look at."""
    try:
        rows = rig.motion(start)
    except OSError:
        return 0.0
    if not len(rows):
        return 0.0
    late = rows[rows[:, 0] > start + fault.asleep + REST_WITHIN]
    if len(late) and late[:, 4].max() > AT_REST:
        raise SeedError(f"{fault.name}: the arm still moves at {late[:, 4].max():.4f} m/s")
    return float(np.linalg.norm(rows[-1, 1:4] - rows[0, 1:4]))


def _place(rig: Rig) -> list[float]:
    place: list[float] = rig.robot.ask("state")["tcp_pose"][:3]
    return place
