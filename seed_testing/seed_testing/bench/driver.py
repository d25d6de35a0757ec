# SPDX-License-Identifier: Apache-2.0
"""Timing of the servo process against the stand-in, with another process loading a core: about two minutes."""

import json
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from seed_testing.bench.processes import BUSY, processes
from seed_testing.fault_bench.bench import FaultBench
from seed_testing.fault_bench.faults import FAULTS, run_fault
from seed_testing.fault_bench.play import play_after_stop

PERIOD, TOLERANCE = 0.002, 0.0003  # [s] of a servo cycle


def run(seconds: float = 60.0) -> dict[str, Any]:
    """Streaming figures over `seconds`, report and recovery times of every fault, motion after Play in a stop."""
    with processes(BUSY), FaultBench() as bench:
        bench.ready()
        bench.sway()
        bench.run(1.0)
        servo = _measure(bench, seconds)
    played = {program: play_after_stop(program) for program in ("checked", "ur_rtde")}
    play = {f"{k}_{unit}": round(v, 5) for k, p in played.items() for unit, v in zip(("m", "m_s"), p, strict=True)}
    return {"servo": servo, "faults": fault_times(), "play_after_stop": play}


def _measure(bench: FaultBench, seconds: float) -> dict[str, Any]:
    """500 Hz streaming: periods, commands received, CPU share of the servo process, latency of targets."""
    periods = json.loads(bench.ask("periods").text)
    bench.robot.ask("reset_stats")
    sent, robot = bench.state.sent, bench.robot.process
    pids = bench.supervisor.pid, robot.pid if robot is not None else None
    cpu, start = [cpu_seconds(pid) for pid in pids], time.monotonic()
    latencies = _stream(bench, seconds)
    elapsed = time.monotonic() - start
    share, robot_share = ((cpu_seconds(pid) - before) / elapsed for pid, before in zip(pids, cpu, strict=True))
    stats, sent = bench.robot.ask("stats"), bench.state.sent - sent
    return {
        "seconds": round(elapsed, 1),
        **_period_figures(periods, json.loads(bench.ask("periods").text)),
        "commands_sent": sent,
        "commands_received": stats["servo_count"],
        "received_period_ms": {k: round(1e3 * v, 3) for k, v in stats["servo_period"].items()},
        "cpu_share": round(share, 4),
        "standin_cpu_share": round(robot_share, 4),
        "latency_ms": {
            name: round(float(np.quantile(latencies, q, method="higher")), 3) if latencies else math.nan
            for name, q in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
        },
        "realtime": os.sched_getscheduler(pids[0] or 0) == os.SCHED_FIFO,
    }


def _stream(bench: FaultBench, seconds: float) -> list[float]:
    """Latency [ms] from handing over a target to the servo command that used it, for the targets seen."""
    latencies, last = [], -1
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        state = bench.step()
        if state.target_number != last:
            last = state.target_number
            latencies.append(1e3 * state.latency)
    return latencies


def _period_figures(before: dict[str, Any], after: dict[str, Any]) -> dict[str, float]:
    """Share of the servo cycles near 2 ms, and the longest of them, from the counts before and after."""
    counts, width = np.subtract(after["counts"], before["counts"]), after["bin_s"]
    centres = (np.arange(len(counts)) + 0.5) * width
    near = counts[np.abs(centres - PERIOD) <= TOLERANCE].sum()
    last = np.flatnonzero(counts)[-1] if counts.any() else 0
    longest = after["max_s"] if last == len(counts) - 1 else (last + 1) * width
    return {
        "period_share_within_0.3_ms": round(float(near / max(1, counts.sum())), 5),
        "period_max_ms": round(1e3 * float(longest), 2) if counts.any() else math.nan,
    }


def cpu_seconds(pid: int | None) -> float:
    """CPU time [s] of all threads of a process."""
    return sum(1e-9 * int(file.read_text().split()[0]) for file in Path("/proc").glob(f"{pid}/task/*/schedstat"))


def fault_times() -> dict[str, Any]:
    """Report [s], recovery [s], coasting and jump [mm] of every fault, each on a fresh bench."""
    out = {}
    for fault in FAULTS:
        with FaultBench("--unlock-after", "0.5") as bench:
            outcome = run_fault(bench, fault)
        out[fault.name] = {
            "report_s": round(outcome.report, 3),
            "recovery_s": round(outcome.recovery, 3),
            "coast_mm": round(1e3 * outcome.coast, 2),
            "jump_mm": round(1e3 * outcome.jump, 4),
            "report_bound_s": fault.report_within,
        }
    return out
