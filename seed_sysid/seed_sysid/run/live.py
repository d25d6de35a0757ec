# SPDX-License-Identifier: Apache-2.0
"""An identification on a live cell, without ROS: streams in, flange targets out, samples to the file.

The first pose, C at the grasp, is remembered in the file's header, so that a resumed run refers to the same grasp. How
the sensor is held may be corrected meanwhile.
"""

import zlib
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from seed_core.errors import FailedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.hand import FINGERS
from seed_core.spatial import Array, inverse_pose, pose_from_rpy, so3_log
from seed_sysid.data.dataset import Header, flat_pose, grip_problem
from seed_sysid.data.sample_file import Recorder
from seed_sysid.parameters import Procedure
from seed_sysid.run.procedure import Command, Reading, Run

STALE = 0.3  # [s] a stream older than this stops the run
PAUSE = 2.0  # [s] between two steps that does
STALE_PRESSURE = 0.5  # [s] of a pressure, as long as the controller counts it
ESTIMATE, WIDTH = "relative_pose", "gripper/width"
PRESSURE = {finger: f"bubble_{finger}/pressure" for finger in FINGERS}
ANEW = (0.5e-3, 0.5)  # [m], [deg] off the first grasp at which a new one in the same run is taken at most
MOST = 1000  # wrenches that are kept for a mean


class LiveError(FailedError):
    """A live identification that cannot start or go on."""


@dataclass
class Streams:
    """The newest of every input; wrenches are averaged between two steps.

    Attributes:
        X_WE: (4, 4) flange, pose_stamp: when it was there [s]. wrenches: (6,) each, about S, in S [N m, N], since the
            last step; wrench: their mean, or the last; wrench_stamp: when the newest came [s].
        pressures: [hPa] by finger. width: of the gripper [m]. slip: [1] of the last three images.
        heard: when each of the inputs that a cell may lack last came [s]: estimate, width and pressures.
    """

    X_WE: Array | None = None
    pose_stamp: float = -np.inf
    wrenches: deque[Array] = field(default_factory=lambda: deque(maxlen=MOST))
    wrench: Array | None = None
    wrench_stamp: float = -np.inf
    pressures: dict[str, float] = field(default_factory=dict)
    width: float | None = None
    estimate: RelativePoseEstimate | None = None
    slip: deque[float] = field(default_factory=lambda: deque(maxlen=3))
    heard: dict[str, float] = field(default_factory=dict)
    held: str = ""  # that the arm holds, and why; empty while it follows targets

    def take_wrench(self) -> Array:
        """Mean (6,) of what came since the last call; the last one if nothing came."""
        if self.wrenches:
            self.wrench = np.mean(self.wrenches, axis=0)
            self.wrenches.clear()
        assert self.wrench is not None
        return self.wrench

    def take_estimate(self, estimate: RelativePoseEstimate, now: float) -> None:
        """Of a new image, at time now [s]."""
        self.estimate, self.heard[ESTIMATE] = estimate, now
        self.slip.append(estimate.slip)

    def take_width(self, width: float, now: float) -> None:
        """Of the gripper [m], at time now [s]."""
        self.width, self.heard[WIDTH] = width, now

    def take_pressure(self, finger: str, pressure: float, now: float) -> None:
        """Of a finger's bubble [hPa], at time now [s]."""
        self.pressures[finger], self.heard[PRESSURE[finger]] = pressure, now

    def begin(self, now: float, needed: Collection[str] = ()) -> None:
        """Leave what came before time now [s] out of the means: an earlier tare, grasp or slip is not this run's.

        An input that a cell may lack, and that is silent by now, is none of this run's either, unless it is needed.
        """
        if self.wrenches:
            self.wrench = self.wrenches[-1]
            self.wrenches.clear()
        self.estimate = None
        self.slip.clear()
        heard = self.heard.items()
        self.heard = {name: t for name, t in heard if name in needed or abs(now - t) <= _patience(name)}
        self.width = self.width if WIDTH in self.heard else None
        self.pressures = {f: value for f, value in self.pressures.items() if PRESSURE[f] in self.heard}

    def missing(self, now: float, needed: Collection[str] = ()) -> str:
        """The input that is missing or stale at time now [s], or that the arm holds; '' if nothing is wrong.

        needed: names of inputs that a cell may lack and this run may not. The others are missed once they have come.
        """
        if self.held:
            return self.held
        always = {"current_pose": self.pose_stamp, "ft_sensor/wrench": self.wrench_stamp}
        for name, stamp in (always | dict.fromkeys(needed, -np.inf) | self.heard).items():
            most = _patience(name)
            if abs(now - stamp) > most:  # ahead of now: the clock was set back
                age = "never came" if np.isinf(stamp) else f"is {now - stamp:.2f} s old (at most {most:g} s)"
                return f"{name} {age}"
        return ""


def _patience(name: str) -> float:
    return STALE_PRESSURE if name in PRESSURE.values() else STALE


class Live:
    """One run: tick() at a fixed rate gives the flange's target and the command behind it."""

    def __init__(
        self,
        procedure: Procedure,
        head: Header,
        X_EC: Array,
        streams: Streams,
        file: Path,
        now: float,
        date: str,
        source: str = "kinematic",
    ) -> None:
        """Start, or continue what the file holds.

        source: of the poses that will be fitted, 'kinematic' or 'estimator', which then must be there.

        Raises:
            LiveError: an input is missing or in another unit, the arm is not at the grasp that the file speaks of, or
                the new grasp that it asks for was taken elsewhere.
            DatasetError: the file belongs to another run.
        """
        if streams.held:
            raise LiveError(f"cannot start: {streams.held}")
        self._needed = (ESTIMATE,) if source == "estimator" else ()
        streams.begin(now, self._needed)
        problem = streams.missing(now, self._needed)
        if problem or streams.X_WE is None:
            first = "arm, sensor and estimator" if self._needed else "the arm and the sensor"
            raise LiveError(f"cannot start: {problem}; start {first} first")
        if problem := grip_problem(streams.width or 0.0, streams.pressures.values()):
            raise LiveError(f"cannot start: {problem}")
        self.streams, self.X_EC = streams, X_EC
        X_WC = streams.X_WE @ X_EC
        grasp = flat_pose(X_WC)
        same = (procedure, [round(v, 9) for v in flat_pose(X_EC)])  # in all poses of a file
        head = replace(
            head,
            run=f"{head.hand} {head.tool} {zlib.crc32(repr(same).encode()):08x}",
            planned=Run(procedure).total,
            grasp_xyz=grasp[:3],
            grasp_rpy=grasp[3:],
            created=date,
        )
        self.recorder, self._folder = Recorder(file, head), file.parent
        head = self.recorder.header
        self.X_WT = pose_from_rpy(head.grasp_rpy, head.grasp_xyz)
        X_TC = inverse_pose(self.X_WT) @ X_WC
        shift, turn = float(np.linalg.norm(X_TC[:3, 3])), float(np.rad2deg(np.linalg.norm(so3_log(X_TC[:3, :3]))))
        limits = procedure.limits
        if shift > limits.translation or turn > limits.rotation_deg:
            self.recorder.close()
            raise LiveError(
                f"the arm is {1e3 * shift:.1f} mm and {turn:.1f} deg from the grasp of {file} (at most "
                f"{1e3 * limits.translation:g} mm and {limits.rotation_deg:g} deg): "
                "bring it back, or choose another output"
            )
        if self.recorder.regrasp and (shift > ANEW[0] or turn > ANEW[1]):  # it is unloaded here, and T is elsewhere
            self.recorder.close()
            raise LiveError(
                f"the tool was lost or slid, and the arm is {1e3 * shift:.1f} mm and {turn:.1f} deg from where {file} "
                f"has its grasp (a new one at most {1e3 * ANEW[0]:g} mm and {ANEW[1]:g} deg): open the gripper, bring "
                "the arm back and grip there, or choose another output"
            )
        self._last: float | None = None  # [s] time of the last tick
        finished, lost = {s.key for s in self.recorder.samples}, self.recorder.lost
        self.run = Run(procedure, finished, head.X_TS, X_TC, lost, self.recorder.grasp)

    @property
    def kept(self) -> str:
        """How much of a run that ends early is kept, and how to go on, in words."""
        return f"{self.run.done} of {self.run.total} poses are kept: call again with output {self._folder} to go on"

    def tick(self, now: float) -> tuple[Array, Command]:
        """Target X_WE (4, 4) for time now [s], and what is being done.

        Raises:
            LiveError: an input went stale, the clock was set, or the run had to end; the arm is to hold.
        """
        since, self._last = 0.0 if self._last is None else now - self._last, now
        problem = self.streams.missing(now, self._needed)
        if not problem and abs(since) > PAUSE:
            problem = (
                f"{since:.2f} s between two steps (at most {PAUSE:g} s): the clock was set, or the node stood still"
            )
        if not problem:
            command = self.run.step(self._reading(now))
            ended = command.regrasp or command.slid
            self.recorder.record(now, command.sample, command.event, command.lost, ended)
            problem = command.failure
        if problem:
            raise LiveError(f"{problem}; {self.kept}")
        return self.X_WT @ command.X_TC @ inverse_pose(self.X_EC), command

    def _reading(self, now: float) -> Reading:
        s = self.streams
        assert s.X_WE is not None
        estimate, s.estimate = s.estimate, None
        told = estimate.of_patches() if estimate is not None and estimate.valid else None
        return Reading(
            stamp=now,
            X_TC=inverse_pose(self.X_WT) @ s.X_WE @ self.X_EC,
            wrench=s.take_wrench(),
            width=s.width if s.width is not None else 0.0,
            pressures=tuple(v for _, v in sorted(s.pressures.items())),
            X_TC_estimated=inverse_pose(told.X_CT) if told is not None else None,
            slip=float(np.median(s.slip)) if s.slip else 0.0,
            gross_slip=estimate is not None and estimate.gross_slip,
            membrane=told.membrane if told is not None else (),
            followed=None if estimate is None else estimate.valid,
        )
