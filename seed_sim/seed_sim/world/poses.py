# SPDX-License-Identifier: Apache-2.0
"""Relative poses of a run in a hidden world: its own images through an estimator that knows nothing of it."""

from collections import deque
from dataclasses import replace

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, make_pose
from seed_estimation import Estimator, TactileImages
from seed_estimation.calibration.file import Calibration
from seed_sim.closed_loop.relative_poses import IMAGE_DELAY, PoseSource, estimator_parameters
from seed_sim.identification.tactile_poses import GRASP_FRAMES, REFERENCE_FRAMES
from seed_sim.plant.plant import DT, Plant
from seed_sim.pressure import PressureSensors
from seed_sim.scenario import Scenario
from seed_sim.world.cameras import WorldCameras
from seed_sim.world.parameters import World

_REFERENCE_AGE = 1.0  # [s] between the reference and the grasp
HANGS = 0.4  # [s] after which a tool hangs still, for a grasp that is taken then


def make_estimator(
    scenario: Scenario, cameras: WorldCameras, calibration: Calibration | None, method: str, period: float
) -> Estimator:
    """The estimator as its user has it: hand as drawn, lenses as calibrated, what the calibration has found.

    With the reference taken, after which membranes and cameras age. Raises SeedError.
    """
    estimator = Estimator(estimator_parameters(scenario, method), scenario.hand, cameras.cameras, calibration)
    start = -_REFERENCE_AGE - period * (REFERENCE_FRAMES + GRASP_FRAMES)
    estimator.capture_reference([cameras.no_contact(start + period * i) for i in range(REFERENCE_FRAMES)])
    cameras.age()
    return estimator


def take_grasp(estimator: Estimator, cameras: WorldCameras, X_CT: Array, t: float, period: float) -> None:
    """The tool rests at X_CT (4, 4), and that is where its frame T is from now on; t [s]: of the next image."""
    times = [t - period * (GRASP_FRAMES - i) for i in range(GRASP_FRAMES)]
    estimator.initialize_grasp([cameras.render(X_CT, u) for u in times])


class WorldPoses(PoseSource):
    """Images of a world, with the time that lies between the two fingers, through the estimator.

    Attributes:
        estimator: as `make_estimator` has it.
        images: the newest pair, by finger.
    """

    def __init__(
        self,
        scenario: Scenario,
        world: World,
        seed: int,
        method: str = "rigid_fit",
        calibration: Calibration | None = None,
        clock_offset: float = 0.0,
        plant: Plant | None = None,
    ) -> None:
        """A grasp in a world.

        Args:
            scenario: as it is believed.
            world: what differs.
            seed: of the images' noise.
            method: of the estimator.
            calibration: as found in this world.
            clock_offset: [s] that is taken off the images' stamps.
            plant: whose membranes are seen, if it has any.
        """
        super().__init__(scenario, scenario.measurement.rate, IMAGE_DELAY, np.eye(4))
        hold = plant.membranes if plant is not None else None
        self._cameras = WorldCameras(scenario, world, seed, hold)
        self._pressures = PressureSensors(scenario, seed)
        self._clock, self._offset = world.images.clock, clock_offset
        self._first = max(self._cameras.early, key=self._cameras.early.__getitem__)  # finger
        self._lead = round(self._cameras.early[self._first] / DT) * DT  # [s] of it before the other
        self._early: deque[TactileImages] = deque()  # the first finger's of the pairs that come next
        self.estimator = make_estimator(scenario, self._cameras, calibration, method, self.period)
        self.images: dict[str, TactileImages] = {}
        self._off = make_pose(np.eye(3), 1e-3 * np.array(world.images.zero_mm))
        self._hanging = world.cell.hanging
        if not self._hanging:
            take_grasp(self.estimator, self._cameras, np.eye(4), 0.0, self.period)
        if hold is not None:
            hold.restart()

    def next_image(self) -> float:
        """When the next image of either finger is due [s], on the plant's steps."""
        return self._due_early() if self._is_early() else super().next_image()

    def _due_early(self) -> float:
        """When the first finger's next image is due [s]; by a lead of several periods it is that of a later pair."""
        return max(self.due(self._count + len(self._early)) - self._lead, 0.0)

    def _is_early(self) -> bool:
        """Whether the first finger's next image comes before the next pair's time."""
        return bool(self._lead) and (not self._early or self._due_early() < super().next_image() - 0.5 * DT)

    def take_image(self, plant: Plant) -> None:
        """Take the image of the finger that is first, if it is its turn, else the pair."""
        if self._is_early():
            plant.solve_membranes()
            of_pair = self.due(self._count + len(self._early))
            self._early.append(self._cameras.finger(self._first, plant.X_CT, of_pair))
            return
        if self._hanging and plant.time >= HANGS:
            take_grasp(self.estimator, self._cameras, plant.X_CT, plant.time, self.period)
            self._hanging = False
        if self._hanging:
            self._count += 1
        else:
            super().take_image(plant)
        if self._early:
            self._early.popleft()

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        plant.solve_membranes()
        images = {f: self._cameras.finger(f, plant.X_CT, plant.time) for f in self._others()}
        if self._early:
            images[self._first] = self._early[0]
        self.images = {f: replace(i, stamp=i.stamp - self._offset) for f, i in images.items()}
        estimate = self.estimator.update(self.images, stamp + self._clock - self._offset)
        estimate = replace(estimate, X_CT=estimate.X_CT @ self._off)
        return self._pressures.into(estimate, plant.grip.pressures, plant.time)

    def _others(self) -> list[str]:
        """Fingers whose images are still to be taken."""
        return [f for f in self._cameras.early if not self._early or f != self._first]
