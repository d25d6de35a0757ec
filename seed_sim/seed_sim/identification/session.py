# SPDX-License-Identifier: Apache-2.0
"""A simulated identification from first to last pose: the run against the cell, every sample written as it comes."""

import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from seed_core.errors import FailedError
from seed_sim.closed_loop.progress import Progress
from seed_sim.identification.cell import EstimatedPoses, SimulatedCell
from seed_sim.identification.membrane_cell import cell_of
from seed_sim.identification.scenario import IdentificationScenario
from seed_sysid.data.dataset import Dataset, Header
from seed_sysid.data.sample_file import Recorder
from seed_sysid.run.procedure import Command, Run

_GRASPS = 8  # of a run at most: each time the estimator has lost the tool for good, it is gripped anew
_SHOW = 1.0  # [s] between lines of progress


Tell = Callable[[Run, float], None]  # of a run and its time [s]


class EndedEarlyError(FailedError):
    """An identification that ended early."""


class ToolLostError(EndedEarlyError):
    """One that ended since the estimator lost the tool again and again, however often it was gripped anew."""


def header(scenario: IdentificationScenario, seed: int, created: str) -> Header:
    """The header of a simulated run."""
    return Header(
        hand=scenario.hand.name,
        tool=scenario.tool.name,
        run=f"simulation {scenario.name} seed {seed} {zlib.crc32(repr(scenario).encode()):08x}",
        planned=Run(scenario.procedure).total,
        sensor_xyz=tuple(scenario.sensor_position),
        sensor_rpy=tuple(np.deg2rad(scenario.sensor_rpy_deg).tolist()),
        sensor_range=(scenario.sensor.range_force, scenario.sensor.range_torque),
        created=created,
    )


def simulate(
    scenario: IdentificationScenario,
    seed: int,
    file: Path | None,
    pose_source: EstimatedPoses | None = None,
    created: str = "",
    cell: SimulatedCell | None = None,
    progress: Progress | None = None,
) -> tuple[Dataset, SimulatedCell]:
    """Run every pose that the file does not have yet.

    Args:
        scenario: of the identification.
        seed: of the hidden stiffness and every fault.
        file: of samples; None keeps them in memory.
        pose_source: renders and estimates poses.
        created: date, for the header.
        cell: another than the scenario's own.
        progress: is told the share of the poses; default: lines on stderr, and nothing with another cell.

    Raises:
        EndedEarlyError: the run ended early; what was measured is in the file.
    """
    tell: Tell | None = _line if cell is None else None
    if progress is not None:
        tell = _moving(progress)
    cell = cell or cell_of(scenario, seed, pose_source)
    recorder = Recorder(file, header(scenario, seed, created))
    samples = recorder.samples
    cell.stamp = samples[-1].stamp if samples else 0.0
    try:
        grasp = samples[-1].grasp + 1 if samples else 0  # this cell's, which is closed on the tool anew
        run = Run(scenario.procedure, {s.key for s in samples}, recorder.header.X_TS, lost=recorder.lost, grasp=grasp)
        last = _loop(run, cell, recorder, tell)
        for _ in range(_GRASPS - 1):
            if last.regrasp:  # what the failure asks of a user, who then goes on
                cell.grip_anew()
                run.regrasped()
                last = _loop(run, cell, recorder, tell)
        if last.failure:
            kind = ToolLostError if last.regrasp else EndedEarlyError
            raise kind(f"{last.failure}; {run.done} of {run.total} poses are kept")
    finally:
        recorder.close()
    return recorder.dataset, cell


def _loop(run: Run, cell: SimulatedCell, recorder: Recorder, tell: Tell | None) -> Command:
    """Until the run is done or has failed; its last command."""
    command = Command(np.eye(4), run.procedure.widths[0], 0, "start")
    shown = time.monotonic()
    while not (command.done or command.failure):
        command = run.step(cell.step(command))
        ended = command.regrasp or command.slid
        recorder.record(cell.stamp, command.sample, command.event, command.lost, ended)
        if tell is not None and time.monotonic() - shown > _SHOW:
            shown = time.monotonic()
            tell(run, cell.stamp)
    return command


def _line(run: Run, stamp: float) -> None:
    """One line that stays the same on a terminal, and one after the other elsewhere."""
    left = run.remaining(stamp) / 60.0
    text = f"pose {run.done} of {run.total}, {stamp / 60.0:.1f} min of robot time"
    text += f", {left:.1f} min of it left" if np.isfinite(left) else ""
    print(f"\r{text:<70}", end="" if sys.stderr.isatty() else "\n", file=sys.stderr, flush=True)


def _moving(progress: Progress) -> Tell:
    def tell(run: Run, stamp: float) -> None:
        progress(run.done / run.total, f"pose {run.done} of {run.total}, {stamp:.0f} s simulated")

    return tell
