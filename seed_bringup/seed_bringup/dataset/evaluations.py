# SPDX-License-Identifier: Apache-2.0
"""Episodes of a task in closed loop without ROS: the task's player is the teacher."""

from collections.abc import Callable

from seed_bringup.dataset.episode import Episode, Frames, three_colours
from seed_control.setpoint.setpoints import HybridSetpoint
from seed_control.state import ControllerState
from seed_control.tasks import Task
from seed_core.errors import FailedError, SeedError
from seed_core.spatial import Wrench
from seed_sim.closed_loop.evaluate import check_task, scenario_of
from seed_sim.closed_loop.relative_poses import PoseSource, check_estimator, pose_source
from seed_sim.closed_loop.run import SeedSteering, play, start_pose
from seed_sim.plant.plant import Plant
from seed_sim.scenario import Scenario, load_scenario

RATE = 250  # [Hz] of the controller


def evaluated(
    task: Task,
    seed: int,
    fps: int,
    estimator: str = "rigid_fit",
    text: str = "",
    checked: Callable[[], None] = lambda: None,
) -> Episode:
    """The episode of a seed.

    Args:
        task: that is played.
        seed: of table, arm and noise.
        fps: frames a second, a divisor of 250.
        estimator: images are kept where it works on them.
        text: the task in words; default: its description.
        checked: is called at each step of the controller, and may raise.

    Raises:
        SeedError: fps does not divide the controller's rate, or the estimator cannot work there.
        FailedError: the task was not finished.
    """
    scenario = check(task, fps, estimator)
    plant = Plant(scenario, seed, task.frame.pose, start_pose(scenario, task))
    poses = pose_source(estimator, scenario, seed, RATE, plant)
    watched = _Watched(SeedSteering(plant, scenario, "seed", estimator, seed, poses), fps, poses, checked)
    recording = play(task, plant, watched)
    if not recording.finished:
        raise FailedError(f"{task.name}, seed {seed}: {recording.message}; not in the dataset")
    return watched.frames.episode(text or task.description or task.name, fps)


def check(task: Task, fps: int, estimator: str) -> Scenario:
    """The scenario of a task that can become an episode. Raises SeedError: it cannot."""
    if RATE % fps:
        raise SeedError(f"--fps {fps} must divide the controller's {RATE} Hz: 10, 25 and 50 do")
    scenario = load_scenario(scenario_of(task))
    check_task(task, scenario, "seed")
    check_estimator(estimator, scenario)
    return scenario


class _Watched:
    """Steers as SEED does, and keeps a frame at every so many steps once a set-point is followed."""

    def __init__(self, steering: SeedSteering, fps: int, source: PoseSource, checked: Callable[[], None]) -> None:
        self.rate = steering.rate
        self.frames = Frames()
        self._steering, self._source, self._checked = steering, source, checked
        self._every, self._count = RATE // fps, 0

    def sense(self, t: float) -> ControllerState:
        self._checked()
        return self._steering.sense(t)

    def steer(self, t: float, setpoint: HybridSetpoint | None) -> str:
        refusal = self._steering.steer(t, setpoint)
        state = self._steering.controller.state
        if setpoint is not None and state.measured_X_CT is not None:
            if self._count % self._every == 0:
                self._keep(setpoint, state)
            self._count += 1
        return refusal

    def _keep(self, setpoint: HybridSetpoint, state: ControllerState) -> None:
        assert state.measured_X_CT is not None
        load = state.estimated.rotated(state.R_W_task) if state.estimated is not None else Wrench.zero()
        images = {side: three_colours(pair.ir) for side, pair in getattr(self._source, "images", {}).items()}
        flange = self._steering.X_WE_reported
        self.frames.add(flange, state.measured_X_CT, load, setpoint.X_W_tip, setpoint.wrench, images)
