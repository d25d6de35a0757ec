# SPDX-License-Identifier: Apache-2.0
"""Relative poses of a simulated run, as the controller gets them: the truth, the truth with noise, or from images."""

from collections import deque
from dataclasses import replace
from typing import Protocol

import numpy as np

from seed_core.bushing import Bushing
from seed_core.config import from_mapping
from seed_core.errors import SeedError
from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array, Wrench, inverse_pose, make_pose, so3_exp
from seed_estimation import METHODS, Estimator, EstimatorParameters, TactileImages
from seed_estimation.gel.image import GelImage
from seed_sim.bubble_renderer import renderer_of
from seed_sim.gel.estimator import calibrate_gels, gel_estimator
from seed_sim.gel.renderer import GelRenderer
from seed_sim.membrane.hold import MembraneHold
from seed_sim.plant.plant import DT, Plant
from seed_sim.pressure import PressureSensors
from seed_sim.scenario import Scenario

FROM_IMAGES = tuple(sorted(METHODS))
GEL = "gel"
ESTIMATORS = ("truth", "noisy", *FROM_IMAGES, GEL)
NOISE_DELAY, IMAGE_DELAY = 0.05, 0.03  # [s] from image to estimate, unless the scenario says otherwise
_REFERENCE_FRAMES, _GRASP_FRAMES = 10, 5


def taken_at(scenario: Scenario, hold: MembraneHold | None = None) -> Array:
    """X_CT (4, 4) of the tool where the grasp is initialized: deflected by what the grasp bears then.

    hold: the membranes, where the grasp is one of membranes; they are left there.
    """
    load = np.array(scenario.grasp.taken_under)
    if hold is not None:
        return hold.under(Wrench(np.zeros(3), load)) if load.any() else np.eye(4)
    return inverse_pose(Bushing(scenario.grasp.stiffness).pose(Wrench(np.zeros(3), -load)))


def estimator_parameters(scenario: Scenario, method: str) -> EstimatorParameters:
    """The estimator's defaults, changed as the scenario says. Raises SeedError."""
    given = {**scenario.estimator, "method": method}
    return from_mapping(given, EstimatorParameters, f"scenario {scenario.name}: estimator")


def refuse_calibrate(scenario: Scenario, where: str) -> None:
    """Raises SeedError: the scenario wants a calibration where none is carried out."""
    if scenario.calibrate:
        raise SeedError(
            f"scenario {scenario.name}: calibrate = true: {where} carries out no calibration: leave it out, or run "
            "./seed validate estimator, or ./seed evaluate --world hidden"
        )


class Poses(Protocol):
    """Where the relative poses of a run come from. `PoseSource` is one that lacks `measure` alone."""

    def next_image(self) -> float:
        """When the next measurement is due [s]; the plant is brought there first."""

    def take_image(self, plant: Plant) -> None:
        """Measure now, at `plant.time` [s]; `plant.X_CT` (4, 4) is the truth."""

    def arrived(self, t: float) -> list[RelativePoseEstimate]:
        """Estimates that have arrived by time t [s] and were not told before."""


class PoseSource:
    """Measures X_CT of the plant at a rate of its own; each estimate arrives after the delay.

    For an estimator of your own derive from it and write `measure`.
    """

    def __init__(self, scenario: Scenario, rate: float, delay: float, X_taken: Array) -> None:
        """rate [Hz], delay [s] unless the scenario says otherwise; X_taken (4, 4): X_CT where the grasp is taken."""
        given = scenario.measurement.delay
        self.delay = delay if given is None else given
        self.period = 1.0 / rate
        self._stamp_error = scenario.measurement.stamp_error
        self._X_TT0 = inverse_pose(X_taken)  # T as the grasp was taken, in the tool's own frame
        self._count = 0
        self._on_their_way: deque[tuple[float, RelativePoseEstimate]] = deque()

    def next_image(self) -> float:
        """When the next measurement is due [s], on the plant's steps."""
        return self.due(self._count)

    def due(self, n: int) -> float:
        """When measurement n is due [s], on the plant's steps; the first is 0."""
        return round(n * self.period / DT) * DT

    def take_image(self, plant: Plant) -> None:
        """Measure now."""
        self._count += 1
        self._on_their_way.append((plant.time + self.delay, self.measure(plant, plant.time + self._stamp_error)))

    def arrived(self, t: float) -> list[RelativePoseEstimate]:
        """Estimates that have arrived by time t [s]."""
        out = []
        while self._on_their_way and self._on_their_way[0][0] <= t + 1e-9:
            out.append(self._on_their_way.popleft()[1])
        return out

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        """The estimate that this image gives, with the stamp [s] that it bears."""
        raise NotImplementedError


class TruePoses(PoseSource):
    """The exact pose, at once, at every control step."""

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        covariance = np.diag([1e-10] * 3 + [1e-12] * 3)
        return RelativePoseEstimate(stamp, plant.X_CT @ self._X_TT0, covariance, method="truth")


class NoisyPoses(PoseSource):
    """The exact pose with white noise on each axis, late."""

    def __init__(self, scenario: Scenario, seed: int, X_taken: Array) -> None:
        m = scenario.measurement
        super().__init__(scenario, m.rate, NOISE_DELAY, X_taken)
        self._rng = np.random.default_rng([seed, 2])
        self._sigma = (np.deg2rad(m.rotation_noise), 1e-3 * m.position_noise)

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        X, (sr, sx) = plant.X_CT @ self._X_TT0, self._sigma
        noise = self._rng.standard_normal(6)
        X = make_pose(so3_exp(sr * noise[:3]) @ X[:3, :3], X[:3, 3] + sx * noise[3:])
        covariance = np.diag([max(sr, 1e-5) ** 2] * 3 + [max(sx, 1e-6) ** 2] * 3)
        return RelativePoseEstimate(stamp, X, covariance, method="noisy")


class PosesFromImages(PoseSource):
    """Rendered images of both bubbles through an estimator of seed_estimation.

    Attributes:
        images: the newest, by finger.
    """

    def __init__(self, scenario: Scenario, seed: int, method: str, hold: MembraneHold | None = None) -> None:
        """hold: the plant's membranes, which the images show; the tool is as it was grasped."""
        X_taken = taken_at(scenario, hold)
        super().__init__(scenario, scenario.measurement.rate, IMAGE_DELAY, X_taken)
        self.renderer = renderer_of(scenario, seed, hold)
        parameters = estimator_parameters(scenario, method)
        self.estimator = Estimator(parameters, scenario.hand, self.renderer.cameras)
        still = [-self.period * (_REFERENCE_FRAMES + _GRASP_FRAMES - i) for i in range(_REFERENCE_FRAMES)]
        self.estimator.capture_reference([self.renderer.no_contact(t) for t in still])
        held = [-self.period * (_GRASP_FRAMES - i) for i in range(_GRASP_FRAMES)]
        self.estimator.initialize_grasp([self.renderer.render(X_taken, t) for t in held])
        self.images: dict[str, TactileImages] = {}
        self._pressures = PressureSensors(scenario, seed)
        if hold is not None:
            hold.restart()

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        plant.solve_membranes()
        self.images = self.renderer.render(plant.X_CT, plant.time)
        estimate = self.estimator.update(self.images, stamp)
        return self._pressures.into(estimate, plant.grip.pressures, plant.time)


class PosesFromGels(PoseSource):
    """Rendered images of both gels, calibrated by a ball, through the estimator over sensors.

    Attributes:
        images: the newest, by finger.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        assert scenario.gel is not None  # as was checked
        X_taken = taken_at(scenario)
        super().__init__(scenario, scenario.measurement.rate, IMAGE_DELAY, X_taken)
        self.renderer = GelRenderer(scenario.gel, scenario.hand, seed)
        self.estimator = gel_estimator(self.renderer, calibrate_gels(self.renderer, seed=seed))
        held = [-self.period * (_GRASP_FRAMES - i) for i in range(_GRASP_FRAMES)]
        self.estimator.initialize_grasp([self.renderer.render(X_taken, t) for t in held])
        self.images: dict[str, GelImage] = {}

    def measure(self, plant: Plant, stamp: float) -> RelativePoseEstimate:
        self.images = self.renderer.render(plant.X_CT, plant.time)
        return self.estimator.update({f: replace(i, stamp=stamp) for f, i in self.images.items()}, stamp)


def check_estimator(kind: str, scenario: Scenario) -> None:
    """Raises SeedError: there is no such source of poses, or the scenario has not what it works on."""
    if kind not in ESTIMATORS:
        raise SeedError(f"estimator '{kind}' is unknown; known: {', '.join(ESTIMATORS)}")
    estimator_parameters(scenario, kind if kind in FROM_IMAGES else EstimatorParameters().method)  # a mistake counts
    if kind == GEL and scenario.gel is None:
        raise SeedError(f"scenario {scenario.name} has no gels: use --scenario gel, or give it a section `gel`")
    if kind in FROM_IMAGES:
        if scenario.gel is not None:
            raise SeedError(f"scenario {scenario.name} has gels, which '{kind}' cannot read: use --estimator {GEL}")
        refuse_calibrate(scenario, "a known world")


def pose_source(
    kind: str, scenario: Scenario, seed: int, control_rate: float, plant: Plant | None = None
) -> PoseSource:
    """The source of that kind, one of ESTIMATORS.

    Args:
        kind, scenario, seed: what it is.
        control_rate: [Hz], that of the truth.
        plant: whose membranes images show; only needed where the scenario has them.

    Raises:
        SeedError: no such kind, the scenario's section `estimator` cannot be used, or the estimator does not see the
            grasp.
    """
    check_estimator(kind, scenario)
    hold = plant.membranes if plant is not None else None
    if kind in FROM_IMAGES:
        return PosesFromImages(scenario, seed, kind, hold)
    if kind == GEL:
        return PosesFromGels(scenario, seed)
    X_taken = taken_at(scenario, hold)
    if hold is not None:
        hold.restart()
    if kind == "truth":
        return TruePoses(scenario, control_rate, 0.0, X_taken)
    return NoisyPoses(scenario, seed, X_taken)
