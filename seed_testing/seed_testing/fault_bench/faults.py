# SPDX-License-Identifier: Apache-2.0
"""The faults that the driver is tested with: what is done to it, how it is undone, how soon it must be reported."""

import math
import os
import signal
import time
from collections.abc import Callable
from typing import NamedTuple

from seed_core.errors import SeedError
from seed_driver.robot.dashboard import dashboard
from seed_driver.robot.link import LinkError
from seed_testing.fault_bench.bench import FaultBench

REST_WITHIN = 0.6  # [s] after a fault: watchdog (0.1 s), braking from 0.04 m/s, servo lag, and a margin
Action = Callable[[FaultBench], object]


class Fault(NamedTuple):
    """One fault; `inject` does it, `undo` undoes it (the controller is back when it returns)."""

    name: str
    inject: Action
    undo: Action = lambda _: None
    report_within: float = 0.1  # [s]
    frozen: float = 0.0  # [s] that the controller itself, arm included, stands still as in a photograph


class Outcome(NamedTuple):
    """Measurements of one fault."""

    report: float  # [s] from the fault to the driver's saying so
    recovery: float  # [s] from the controller's return to following targets again
    coast: float  # [m] travelled after the fault
    jump: float  # [m] moved on recovery without a target


def _ask(action: str, **arguments: object) -> Action:
    return lambda bench: bench.robot.ask(action, **arguments)


def _wait(seconds: float) -> Action:
    return lambda bench: bench.run(seconds)


def _protective_stop(program: str) -> Action:
    """A protective stop in which the program is `program` afterwards."""

    def stop(bench: FaultBench) -> None:
        bench.robot.ask("option", name="program_on_stop", value=program)
        bench.robot.ask("protective_stop")

    return stop


def _signal(number: int) -> Action:
    """A signal to the servo process."""

    def send(bench: FaultBench) -> None:
        if bench.supervisor.pid is not None:
            os.kill(bench.supervisor.pid, number)

    return send


def _unlock(bench: FaultBench) -> None:
    _insist(bench, "close safety popup", "unlock protective stop")


def _power_up(bench: FaultBench) -> None:
    bench.robot.ask("release_emergency_stop")
    _insist(bench, "power on", "brake release")


def _insist(bench: FaultBench, *commands: str) -> None:
    """Dashboard commands until the last releases: the stop may be locked, the dashboard be away for a while."""
    until, said = time.monotonic() + 8.0, ""
    while "releasing" not in said.lower():
        if time.monotonic() > until:
            raise SeedError(f"the stand-in does not answer '{commands[-1]}' with 'releasing' but with '{said}'")
        try:
            said = dashboard(bench.robot.host, *commands)
        except LinkError as error:
            said = str(error)
        bench.run(0.1)


def _corrupted(name: str, index: int, value: float) -> tuple[Action, Action]:
    """A number of an output that cannot be, and its undoing."""
    return _ask("corrupt", name=name, index=index, value=value), _ask("corrupt", name=name)


def _free_ready_bit(bench: FaultBench) -> None:
    bench.robot.ask("switch", name="stuck_ready", on=False)
    bench.run(0.2)


FAULTS = (
    Fault("controller killed", lambda bench: bench.robot.kill(), lambda bench: bench.robot.start()),
    Fault("controller frozen 1 s", _ask("freeze", seconds=1.0), _wait(0.2), 0.2, 1.0),
    Fault("controller frozen 4 s", _ask("freeze", seconds=4.0), _wait(0.2), 0.2, 4.0),
    Fault("outputs paused 0.3 s", _ask("pause_outputs", seconds=0.3), _wait(0.5), 0.2),
    Fault("outputs paused 3 s", _ask("pause_outputs", seconds=3.0), _wait(3.1), 0.2),
    Fault("network silent 1 s", _ask("silence", seconds=1.0), _wait(1.1), 0.2),
    Fault("RTDE connections dropped", _ask("drop_rtde")),
    Fault("all connections dropped", _ask("drop_all")),
    Fault("connections refused 1 s", _ask("refuse", seconds=1.0), _wait(1.1)),
    Fault("protective stop, program paused", _protective_stop("paused"), _unlock),
    Fault("protective stop, program stopped", _protective_stop("stopped"), _unlock),
    Fault("protective stop, program playing", _protective_stop("playing"), _unlock),
    Fault("emergency stop", _ask("emergency_stop"), _power_up),
    Fault("program stopped on the pendant", _ask("pendant_stop")),
    Fault("ready bit stuck", _ask("switch", name="stuck_ready"), _free_ready_bit),
    Fault("pose not a number", *_corrupted("actual_TCP_pose", 2, math.nan)),
    Fault("joint angle infinite", *_corrupted("actual_q", 0, math.inf)),
    Fault("safety mode -1", *_corrupted("safety_mode", 0, -1)),
    Fault("clock not a number", *_corrupted("timestamp", 0, math.nan)),
    Fault("servo process killed", _signal(signal.SIGKILL)),
    Fault("servo process crashes", _signal(signal.SIGSEGV)),
    Fault("servo process stopped", _signal(signal.SIGSTOP), _wait(0.7)),
)


def run_fault(bench: FaultBench, fault: Fault, moving: float = 0.5) -> Outcome:
    """Move, let the fault happen, check that the arm rests, undo, recover, check that nothing jumps.

    Args:
        moving: [s] of motion before the fault.

    Raises:
        SeedError: the arm does not come to rest, jumps, or does not recover.
    """
    bench.ready()
    bench.sway()
    bench.run(moving)
    start = time.monotonic()
    fault.inject(bench)
    bench.wait(lambda s: not s.armed, 5.0, f"report of '{fault.name}'")
    report = time.monotonic() - start
    bench.run(fault.frozen + REST_WITHIN)
    try:
        coast = bench.travel(start, rest_from=start + fault.frozen + REST_WITHIN)
        fault.undo(bench)
        recovery, jump = bench.recover_in_place()
    except SeedError as error:
        raise SeedError(f"{fault.name}: {error}") from error
    return Outcome(report, recovery, coast, jump)
