# SPDX-License-Identifier: Apache-2.0
"""One goal of the action ~/identify_stiffness: poses are visited, then analysed in a thread, then results written."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from seed_msgs.action import IdentifyStiffness

from seed_core.clocks import save_clocks
from seed_core.errors import SeedError
from seed_core.spatial import Array
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.fit.clock_offset import ClockError, ClockOffset, ClockWatch
from seed_sysid.report.results import write_results
from seed_sysid.report.summary import summary
from seed_sysid.run.live import Live, LiveError
from seed_sysid.run.procedure import Command


class GoalCancelledError(LiveError):
    """The goal was cancelled; what was measured is kept."""


class ClocksBefore(NamedTuple):
    """What the estimator already took off the stamps when a run began [s], and the names for clocks.yaml."""

    offset: float = 0.0
    robot: str = ""
    cameras: str = ""


class ActiveGoal:
    """A goal being worked on.

    Attributes:
        goal, live: the action's handle, and the run.
        target: X_WE (4, 4) to go to.
        clocks: compares the cameras' clock with the robot's.
        finished: future of the action's result.
        fed_back: [s] time of the last feedback.
    """

    def __init__(
        self, goal: ServerGoalHandle, live: Live, folder: Path, source: str, X_WE: Array, before: ClocksBefore
    ) -> None:
        """source: of the poses, 'kinematic' or 'estimator'; results go into the folder."""
        self.goal, self.live, self._folder, self._source = goal, live, folder, source
        self.target = X_WE
        self.clocks, self._clocks_before = ClockWatch(), before
        self.finished = Future()
        self.fed_back = 0.0
        self._worker = ThreadPoolExecutor(1)
        self._visited = False

    @property
    def visiting(self) -> bool:
        """Whether poses are being visited."""
        return not self._visited

    def visit(self, now: float) -> Command:
        """What to do at `now` [s]; after the last pose the analysis starts.

        Raises:
            GoalCancelledError: the goal was cancelled.
            LiveError: the run cannot go on.
        """
        self._check_cancelled()
        self.target, command = self.live.tick(now)
        if command.done:
            self._visited = True
            self._job = self._worker.submit(self._analyse)
        return command

    def _check_cancelled(self) -> None:
        if self.goal.is_cancel_requested:
            raise GoalCancelledError(f"cancelled; {self.live.kept}")

    def result(self) -> IdentifyStiffness.Result | None:
        """The written result, or None while it is being worked out.

        Raises:
            GoalCancelledError: the goal was cancelled.
            SeedError, OSError: there is none, whatever the analysis stumbled over; the samples are kept.
        """
        self._check_cancelled()
        if not self._job.done():
            return None
        try:
            return self._written(*self._job.result())
        except (SeedError, OSError):
            raise
        except Exception as error:  # the node goes on: what took minutes to measure can be fitted again
            raise LiveError(
                f"the analysis failed ({type(error).__name__}: {error}); the samples are kept: fit them again with "
                f"./seed identify --from {self._folder / 'samples.jsonl'}"
            ) from error

    def _written(self, analysis: Analysis, clock: ClockOffset | None, remarks: list[str]) -> IdentifyStiffness.Result:
        figures = summary(analysis) | {"camera_clock": asdict(clock) if clock else None}
        write_results(self._folder, analysis, figures, date())
        if clock is not None:
            offset, robot, cameras = self._clocks_before
            save_clocks(self._folder / "clocks.yaml", offset + clock.value, clock.std, date(), robot, cameras)
        stiffness = self._folder / "stiffness.yaml"  # not there where an axis is undetermined
        k, std = (value.stiffness[analysis.nominal] for value in (analysis.solution.value, analysis.solution.std))
        return IdentifyStiffness.Result(
            success=True,
            message="; ".join([*analysis.warnings, *remarks]),
            stiffness_file=str(stiffness) if stiffness.exists() else "",
            rotation=k[:3],
            translation=k[3:],
            rotation_std=std[:3],
            translation_std=std[3:],
        )

    def _analyse(self) -> tuple[Analysis, ClockOffset | None, list[str]]:
        """The analysis, the cameras' clock against the robot's, and remarks about that."""
        analysis = analyse(self.live.recorder.dataset, self._source, self.live.run.procedure.fit)
        if not self.clocks.seen:
            return analysis, None, []
        try:
            clock = self.clocks.offset()
        except ClockError as error:
            return analysis, None, [str(error)]
        return analysis, clock, [clock.advice] if clock.advice else []

    def close(self) -> None:
        """Close the file of samples; an analysis that has not begun is left out."""
        self.live.recorder.close()
        self._worker.shutdown(wait=False, cancel_futures=True)


def date() -> str:
    """Of today, in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
