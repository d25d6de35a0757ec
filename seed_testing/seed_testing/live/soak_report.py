# SPDX-License-Identifier: Apache-2.0
"""What a soak has sampled, and what it says: levels, lost frames, real-time factor."""

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np

from seed_testing.live.processes import Usage
from seed_testing.live.slopes import slope

MEMORY_RISE = 6.0  # [MB/h] that a process may surely rise by
LATE_FRAMES = 50  # both count at moments of their own, up to a second apart
CLIENT = "client"  # this process, which keeps its samples
PICTURES = "page.pictures"  # figure: tactile pictures that an open page was sent
FEW = 1.0  # [1/s] of them: the page hangs, however busy the machine is
IMAGES_A_SET = 2.0  # pictures of both fingers make one estimate


class Samples:
    """Of one run: usage by process, and figures, over time."""

    def __init__(self) -> None:
        self.times: list[float] = []  # [s]
        self.usage: list[dict[str, Usage]] = []
        self.figures: list[dict[str, float]] = []
        self.loads: list[float] = []  # of the machine, averaged over a minute
        self.tasks, self.holds, self.bag_mb = 0, list[str](), 0.0

    def add(self, time: float, usage: dict[str, Usage], figures: dict[str, float]) -> None:
        """One sample at a time [s]."""
        self.times.append(time)
        self.usage.append(usage)
        self.figures.append(figures)
        self.loads.append(os.getloadavg()[0])

    def of(self, process: str, what: str) -> tuple[np.ndarray, np.ndarray]:
        """Hours and values of one process where it was sampled."""
        there = [(t, getattr(u[process], what)) for t, u in zip(self.times, self.usage, strict=True) if process in u]
        t, v = np.array(there, dtype=float).T if there else np.zeros((2, 0))
        return (t - (self.times[0] if self.times else 0.0)) / 3600.0, v

    def processes(self) -> list[str]:
        """Names of all."""
        return sorted({name for u in self.usage for name in u})

    def write(self, file: Path) -> None:
        """A CSV file with a line per sample."""
        usage = [(p, w) for p in self.processes() for w in Usage._fields]
        figures = sorted({name for f in self.figures for name in f})
        with file.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(["seconds", "load", *(f"{p}.{w}" for p, w in usage), *figures])
            for t, load, u, f in zip(self.times, self.loads, self.usage, self.figures, strict=True):
                cells = [getattr(u[p], w) if p in u else "" for p, w in usage]
                writer.writerow([f"{t - self.times[0]:.1f}", f"{load:.2f}", *cells, *(f.get(n, "") for n in figures)])


def summary(s: Samples) -> dict[str, Any]:
    """Figures of a run, and its verdict: 'level', or what grew or was lost unsaid."""
    problems, processes = [], {}
    for name in s.processes():
        hours, rss = s.of(name, "rss")
        line, last = slope(hours, rss), {w: s.of(name, w)[1] for w in ("files", "threads")}
        processes[name] = {
            "rss_mb": round(float(rss[-1]), 1),
            "rss_mb_per_hour": round(line.rate, 2) if line else None,
            "deviation_mb_per_hour": round(line.deviation, 2) if line else None,
            **{w: int(v[-1]) for w, v in last.items()},
        }
        if line is not None and name != CLIENT and line.rises(MEMORY_RISE):
            problems.append(f"{name}: memory rises by {line.rate:.1f} MB/h")
        problems += [f"{name}: {w} rise from {a:g} to {b:g}" for w, v in last.items() for a, b in [_levels(v)] if b > a]
    sent, told, lost = frames(s)
    if sent - told - lost > LATE_FRAMES:
        problems.append(f"{sent - told - lost:.0f} of {sent:.0f} image sets were lost, and nothing counts them")
    seen = pictures(s)
    if seen is not None and lost + told > 0 and seen < FEW:
        problems.append(f"the page was sent {seen:.1f} pictures a second")
    factors = [f for x in s.figures if np.isfinite(f := x["real_time_factor"])]
    if len(s.times) < 2 or not s.tasks:
        problems.append("no task was played")
    return {
        "verdict": "; ".join(problems) or "level",
        "minutes": round((s.times[-1] - s.times[0]) / 60.0, 1) if s.times else 0.0,
        "tasks": s.tasks,
        "holds": s.holds,
        "real_time_factor": round(float(np.median(factors)), 3) if factors else None,
        "load": round(float(np.median(s.loads)), 1) if s.loads else None,
        "image_sets": {"sent": sent, "used": told, "counted_as_missing": lost},
        "page_pictures_per_s": None if seen is None else round(seen, 1),
        "bag_mb": round(s.bag_mb, 1),
        "processes": processes,
    }


def frames(s: Samples) -> tuple[float, float, float]:
    """Sets of images sent, paired by the estimator, and missing by the stamps, from the first sample with both on."""
    both = [f for f in s.figures if "bubbles.pairs" in f and "estimator.pairs" in f]
    if len(both) < 2:
        return 0.0, 0.0, 0.0
    first, last = both[0], both[-1]

    def rise(name: str) -> float:
        return last.get(name, 0.0) - first.get(name, 0.0)

    return rise("bubbles.pairs") / IMAGES_A_SET, rise("estimator.pairs"), rise("estimator.sets_missing")


def pictures(s: Samples) -> float | None:
    """[1/s] that a page was sent while it was open; None: none was."""
    open_ = [(t, f[PICTURES]) for t, f in zip(s.times, s.figures, strict=True) if PICTURES in f]
    if len(open_) < 2:
        return None
    (began, first), (ended, last) = open_[0], open_[-1]
    return (last - first) / (ended - began)


def _levels(v: np.ndarray) -> tuple[float, float]:
    """The highest value of the second quarter, and the lowest of the last one: it rose when all of that lies above."""
    n = len(v) // 4
    return (float(v[n : 2 * n].max()), float(v[-n:].min())) if n else (0.0, 0.0)


def words(result: dict[str, Any]) -> list[str]:
    """The summary for people."""
    sets, seen = result["image_sets"], result["page_pictures_per_s"]
    lines = [
        f"{result['tasks']} tasks in {result['minutes']} min at load {result['load']}, real-time factor "
        f"{result['real_time_factor']}; {len(result['holds'])} ended early",
        *(f"  early: {reason}" for reason in result["holds"]),
        f"image sets: {sets['sent']:.0f} sent, {sets['used']:.0f} used, "
        f"{sets['counted_as_missing']:.0f} missing by the stamps",
        *([f"page open: {seen} pictures a second"] if seen is not None else []),
        f"{'process':<16} {'MB':>7} {'MB/h':>7} {'+-':>6} {'files':>6} {'threads':>8}",
    ]
    for name, p in result["processes"].items():
        rate, deviation = (("-" if p[k] is None else p[k]) for k in ("rss_mb_per_hour", "deviation_mb_per_hour"))
        lines.append(f"{name:<16} {p['rss_mb']:>7} {rate:>7} {deviation:>6} {p['files']:>6} {p['threads']:>8}")
    return [*lines, f"verdict: {result['verdict']}"]


def plot(s: Samples, file: Path) -> None:
    """Memory of each process over time."""
    from matplotlib.figure import Figure

    from seed_sim.replay.plots import save

    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes = figure.subplots()
    for name in s.processes():
        hours, rss = s.of(name, "rss")
        axes.plot(60.0 * hours, rss, label=name, linewidth=1.0)
    axes.set_xlabel("time [min]")
    axes.set_ylabel("memory [MB]")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize="x-small", ncols=2)
    save(figure, file, dpi=120)
