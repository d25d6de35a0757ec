# SPDX-License-Identifier: Apache-2.0
"""Where the controller's relative poses come from in a simulation: the truth, the truth with noise, or images."""

from __future__ import annotations

from collections import deque

import numpy as np

from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import make_pose, so3_exp
from seed_sim.plant.plant import DT, Plant
from seed_sim.scenario import Scenario

ESTIMATORS = ("truth", "noisy", "published", "rigid_fit")
_NOISE_DELAY, _IMAGE_DELAY = 0.05, 0.03  # [s] unless the scenario says otherwise
_REFERENCE_FRAMES, _GRASP_FRAMES = 10, 5


class Source:
    """Takes pictures of the plant at its own rate; each becomes an estimate that arrives after the delay."""

    def __init__(self, scenario: Scenario, seed: int, delay: float) -> None:
        self.scenario = scenario
        given = scenario.measurement.delay
        self.delay = delay if given is None else given
        self.period = 1.0 / scenario.measurement.rate
        self._count = 0
        self._waiting: deque[tuple[float, RelativePoseEstimate]] = deque()
        self._rng = np.random.default_rng([seed, 2])

    def next_image(self) -> float:
        """When the next picture is due [s], on the plant's steps."""
        return round(self._count * self.period / DT) * DT

    def look(self, plant: Plant) -> None:
        """Take a picture now."""
        self._count += 1
        estimate = self._measure(plant)
        self._waiting.append((plant.time + self.delay, estimate))

    def arrived(self, t: float) -> list[RelativePoseEstimate]:
        """Estimates that have arrived by time t [s]."""
        out = []
        while self._waiting and self._waiting[0][0] <= t + 1e-9:
            out.append(self._waiting.popleft()[1])
        return out

    def _measure(self, plant: Plant) -> RelativePoseEstimate:
        raise NotImplementedError


class Truth(Source):
    """The exact pose, at once, at every control step."""

    def __init__(self, scenario: Scenario, seed: int, rate: float) -> None:
        super().__init__(scenario, seed, 0.0)
        self.period = 1.0 / rate

    def _measure(self, plant: Plant) -> RelativePoseEstimate:
        covariance = np.diag([1e-10] * 3 + [1e-12] * 3)
        return RelativePoseEstimate(plant.time, plant.X_CT, covariance, method="truth")


class Noisy(Source):
    """The exact pose with white noise on each axis, late."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        super().__init__(scenario, seed, _NOISE_DELAY)
        m = scenario.measurement
        self._sigma = (np.deg2rad(m.rotation_noise), 1e-3 * m.position_noise)

    def _measure(self, plant: Plant) -> RelativePoseEstimate:
        X, (sr, sx) = plant.X_CT, self._sigma
        noise = self._rng.standard_normal(6)
        X = make_pose(so3_exp(sr * noise[:3]) @ X[:3, :3], X[:3, 3] + sx * noise[3:])
        covariance = np.diag([max(sr, 1e-5) ** 2] * 3 + [max(sx, 1e-6) ** 2] * 3)
        return RelativePoseEstimate(plant.time, X, covariance, method="noisy")


class Images(Source):
    """Rendered images of both bubbles through an estimator of seed_estimation."""

    def __init__(self, scenario: Scenario, seed: int, method: str) -> None:
        super().__init__(scenario, seed, _IMAGE_DELAY)
        from seed_estimation import Estimator, EstimatorParameters
        from seed_sim.tactile import TactileRenderer
        from seed_testing.validation.run import tactile_of

        self.renderer = TactileRenderer(tactile_of(scenario), scenario.hand, seed)
        self.estimator = Estimator(EstimatorParameters(method=method), scenario.hand, self.renderer.cameras)
        still = [-self.period * (_REFERENCE_FRAMES + _GRASP_FRAMES - i) for i in range(_REFERENCE_FRAMES)]
        self.estimator.capture_reference([self.renderer.no_contact(t) for t in still])
        held = [-self.period * (_GRASP_FRAMES - i) for i in range(_GRASP_FRAMES)]
        self.estimator.initialize_grasp([self.renderer.render(np.eye(4), t) for t in held])

    def _measure(self, plant: Plant) -> RelativePoseEstimate:
        return self.estimator.update(self.renderer.render(plant.X_CT, plant.time), plant.time)


def source_for(kind: str, scenario: Scenario, seed: int, control_rate: float) -> Source:
    """The source of that kind. Raises SeedError."""
    if kind == "truth":
        return Truth(scenario, seed, control_rate)
    if kind == "noisy":
        return Noisy(scenario, seed)
    if kind in ("published", "rigid_fit"):
        return Images(scenario, seed, kind)
    raise SeedError(f"estimator '{kind}' is unknown; known: {', '.join(ESTIMATORS)}")
