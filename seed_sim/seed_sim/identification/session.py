# SPDX-License-Identifier: Apache-2.0
"""A simulated identification from first to last pose: the run against the cell, every sample written as it comes."""

from __future__ import annotations

import sys
import time
import zlib
from pathlib import Path

import numpy as np

from seed_core.errors import FailedError
from seed_sim.identification.cell import PoseSource, SimulatedCell
from seed_sim.identification.scenario import IdentificationScenario
from seed_sysid.data.dataset import Dataset, Header, Sample, Writer
from seed_sysid.run.excitation import design
from seed_sysid.run.procedure import Command, Run, average

_SHOW = 1.0  # [s] between lines of progress


class SessionError(FailedError):
    """An identification that ended early."""


def header(scenario: IdentificationScenario, seed: int, planned: int, created: str) -> Header:
    """The header of a simulated run."""
    return Header(
        hand=scenario.hand.name,
        tool=scenario.tool.name,
        run=f"simulation {scenario.name} seed {seed} {hash_text(repr(scenario)):08x}",
        planned=planned,
        sensor_xyz=tuple(scenario.sensor_position),
        sensor_rpy=tuple(float(v) for v in np.deg2rad(scenario.sensor_rpy_deg)),
        sensor_range=(scenario.sensor.range_force, scenario.sensor.range_torque),
        created=created,
    )


def hash_text(text: str) -> int:
    """A number that is the same in every process, to tell settings apart."""
    return zlib.crc32(text.encode())


def simulate(
    scenario: IdentificationScenario,
    seed: int,
    file: Path | None,
    pose_source: PoseSource | None = None,
    created: str = "",
) -> tuple[Dataset, SimulatedCell]:
    """Run every pose that the file does not have yet.

    Raises:
        SessionError: the run ended early; what was measured is in the file.
    """
    cell = SimulatedCell(scenario, seed, pose_source)
    empty = Run(scenario.procedure)
    head = header(scenario, seed, empty.total, created)
    writer = Writer(file, head) if file else None
    samples = list(writer.finished) if writer else []
    cell.stamp = samples[-1].stamp if samples else 0.0
    run = Run(scenario.procedure, {s.key for s in samples}, head.X_TS)
    try:
        _loop(run, cell, samples, writer)
    finally:
        if writer:
            writer.close()
    return Dataset(writer.header if writer else head, samples), cell


def at_rest(scenario: IdentificationScenario, seed: int) -> tuple[Dataset, SimulatedCell]:
    """The same data without the motion between and the settling: for studies of the fit over many seeds."""
    cell = SimulatedCell(scenario, seed)
    p = scenario.procedure
    targets = design(p.excitation, p.limits, p.fit.model)
    readings = max(1, round(p.settle.average * scenario.rate))
    samples = []
    for grip, width in enumerate(p.widths):
        for target in targets:
            command = Command(target.X_TC, width, grip, "measuring")
            samples.append(average(target, grip, cell.rest(command, readings), 1.0, False))
    return Dataset(header(scenario, seed, len(samples), ""), samples), cell


def _loop(run: Run, cell: SimulatedCell, samples: list[Sample], writer: Writer | None) -> None:
    command = Command(np.eye(4), run.procedure.widths[0], 0, "start")
    shown = time.monotonic()
    while not command.done:
        command = run.step(cell.step(command))
        if command.event and writer:
            writer.event(cell.stamp, command.event)
        if command.sample:
            samples.append(command.sample)
            if writer:
                writer.add(command.sample)
        if command.failure:
            raise SessionError(f"{command.failure}; {run.done} of {run.total} poses are kept")
        if time.monotonic() - shown > _SHOW:
            shown = time.monotonic()
            _progress(run, cell)


def _progress(run: Run, cell: SimulatedCell) -> None:
    left = run.remaining(cell.stamp) / 60.0
    text = f"pose {run.done} of {run.total}, {cell.stamp / 60.0:.1f} min simulated, {left:.1f} min left"
    print(f"\r{text:<70}", end="\n" if not sys.stderr.isatty() else "", file=sys.stderr, flush=True)
