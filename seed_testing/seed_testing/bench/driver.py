# SPDX-License-Identifier: Apache-2.0
"""Timing of the servo process against the stand-in, with another process loading a core.

`run()` returns the figures; `python -m seed_testing.bench.driver` prints them as JSON (about two minutes).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from typing import Any

from seed_driver.process.period_histogram import share_within
from seed_testing.fault_bench.bench import Rig
from seed_testing.fault_bench.faults import FAULTS, Outcome, suffer

BUSY = "while True: sum(range(10000))"


def run(seconds: float = 60.0, load: bool = True, faults: bool = True) -> dict[str, Any]:
    """Streaming figures over `seconds`, then report and recovery times of every fault."""
    out = {"servo": servo(seconds, load)}
    if faults:
        out["faults"] = fault_times()
    return out


def servo(seconds: float, load: bool) -> dict[str, Any]:
    """500 Hz streaming: periods, commands received, CPU share of the servo process, latency of targets."""
    busy = subprocess.Popen([sys.executable, "-c", BUSY]) if load else None
    try:
        with Rig() as rig:
            rig.ready()
            rig.sway()
            rig.run(1.0)
            return _measure(rig, seconds)
    finally:
        if busy is not None:
            busy.kill()
            busy.wait()


def _measure(rig: Rig, seconds: float) -> dict[str, Any]:
    before = json.loads(rig.ask("periods").text)
    rig.robot.ask("reset_stats")
    sent, pid = rig.state.sent, rig.supervisor.pid
    robot_pid = rig.robot.process.pid if rig.robot.process else None
    cpu, robot_cpu, start = cpu_seconds(pid), cpu_seconds(robot_pid), time.monotonic()
    latencies = _stream(rig, seconds)
    elapsed = time.monotonic() - start
    used, robot_used = cpu_seconds(pid) - cpu, cpu_seconds(robot_pid) - robot_cpu
    stats = rig.robot.ask("stats")
    sent = rig.state.sent - sent
    after = json.loads(rig.ask("periods").text)
    counts = [b - a for a, b in zip(before["counts"], after["counts"], strict=True)]
    histogram = {**after, "counts": counts}
    return {
        "seconds": round(elapsed, 1),
        "period_share_within_0.3_ms": round(share_within(histogram, 0.002, 0.0003), 5),
        "period_max_ms": round(1e3 * _largest(histogram), 2),
        "commands_sent": sent,
        "commands_received": stats["servo_count"],
        "received_period_ms": {k: round(1e3 * v, 3) for k, v in stats["servo_period"].items()},
        "cpu_share": round(used / elapsed, 4),
        "standin_cpu_share": round(robot_used / elapsed, 4),
        "latency_ms": {
            "p50": quantile(latencies, 0.5),
            "p99": quantile(latencies, 0.99),
            "max": quantile(latencies, 1.0),
        },
        "realtime": os.sched_getscheduler(pid or 0) == os.SCHED_FIFO,
    }


def _stream(rig: Rig, seconds: float) -> list[float]:
    """Latency [ms] from handing over a target to the servo command that used it, for the targets seen."""
    latencies, last = [], -1
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        state = rig.step()
        if state.target_number != last:
            last = state.target_number
            latencies.append(1e3 * state.latency)
    return latencies


def _largest(histogram: dict[str, Any]) -> float:
    """Upper edge [s] of the last bin in use."""
    used = [i for i, n in enumerate(histogram["counts"]) if n]
    if not used:
        return math.nan
    return float(
        histogram["max_s"] if used[-1] == len(histogram["counts"]) - 1 else (used[-1] + 1) * histogram["bin_s"]
    )


def quantile(values: list[float], share: float) -> float:
    """Rounded to microseconds when in milliseconds."""
    ordered = sorted(values)
    return round(ordered[min(len(ordered) - 1, int(share * len(ordered)))], 3) if ordered else math.nan


def cpu_seconds(pid: int | None) -> float:
    """CPU time [s] of all threads of a process."""
    if pid is None:
        return 0.0
    total = 0.0
    for thread in os.listdir(f"/proc/{pid}/task"):
        with open(f"/proc/{pid}/task/{thread}/schedstat", encoding="ascii") as file:
            total += int(file.read().split()[0]) * 1e-9
    return total


def fault_times() -> dict[str, Any]:
    """Report [s], recovery [s], coasting and jump [mm] of every fault, each on a fresh rig."""
    out = {}
    for fault in FAULTS:
        with Rig("--unlock-after", "0.5") as rig:
            outcome = suffer(rig, fault)
        out[fault.name] = {**_rounded(outcome), "report_bound_s": fault.report_within}
    return out


def _rounded(o: Outcome) -> dict[str, float]:
    return {
        "report_s": round(o.report, 3),
        "recovery_s": round(o.recovery, 3),
        "coast_mm": round(1e3 * o.coast, 2),
        "jump_mm": round(1e3 * o.jump, 4),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="seed_testing.bench.driver", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the streaming run (default %(default)s)")
    parser.add_argument("--no-load", action="store_true", help="no other process loads a core")
    parser.add_argument("--no-faults", action="store_true", help="streaming only")
    given = parser.parse_args()
    print(json.dumps(run(given.seconds, not given.no_load, not given.no_faults), indent=1))


if __name__ == "__main__":
    main()
