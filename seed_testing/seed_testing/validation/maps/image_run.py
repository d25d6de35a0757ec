# SPDX-License-Identifier: Apache-2.0
"""A random membrane identified by the suite's own procedure from its images, and then moved on all six axes at once.

The estimator is in the loop: what the material does is what it tells, in the identification and in use.
"""

from dataclasses import replace

import numpy as np

from seed_core.estimate import RelativePoseEstimate
from seed_core.spatial import Array
from seed_sim.identification.cell import SimulatedCell
from seed_sim.identification.scenario import IdentificationScenario, identify_on_membrane, load
from seed_sim.identification.session import simulate
from seed_sim.identification.tactile_poses import TactilePoses
from seed_sim.membrane import MembraneGrasp
from seed_sim.scenario import Scenario, on_membrane, tactile_of
from seed_sim.tactile.parameters import ToolShape
from seed_sim.world.procedures.membranes import closed_until_borne
from seed_sysid.fit.analysis import Analysis, analyse
from seed_testing.validation.maps.membrane_run import RADII, RATE, Run, Truth, combined_motion, poses, size_of

SPACING = 0.0052  # [m] of nodes
IMAGES = 3  # for each frame of a motion: 30 Hz


def scenario_of(seed: int) -> IdentificationScenario:
    """A round handle in the light grip of a random membrane."""
    scenario = identify_on_membrane(load("default"), seed)
    drawn = on_membrane(Scenario(tactile=scenario.tactile), seed)
    handle = ToolShape(radius=float(np.random.default_rng([seed, 0x3A9]).uniform(*RADII)))
    return replace(
        scenario,
        membrane=replace(drawn.membrane, spacing=SPACING),
        tactile=replace(tactile_of(drawn), tool=handle),
    )


def run_on_images(seed: int, shares: tuple[float, ...], frames: int) -> Run:
    """Identify the random membrane of a seed, and move it.

    Where the light grip bears no poses as large as a map needs, the gripper is closed further, as the report advises.

    Args:
        seed: draws membrane, dots, handle, sensor and motion.
        shares: motions in which so many of the touching nodes slide, on average.
        frames: of each motion at RATE; there are IMAGES times as many images.

    Raises:
        SeedError: the membrane cannot be inflated or grasped, or the estimator does not follow it.
    """
    rng = np.random.default_rng([seed, 0x1336])

    def identify(at: IdentificationScenario) -> tuple[Analysis, TactilePoses]:
        seen = TactilePoses(at, seed)
        data, _ = simulate(at, seed, None, seen, progress=lambda *_: None)
        return analyse(data, "estimator"), seen

    light = scenario_of(seed)
    scenario, analysis, seen = closed_until_borne(light, identify)
    motion = combined_motion(rng, IMAGES * frames, IMAGES * RATE)
    grasp = MembraneGrasp(scenario.membrane, scenario.tactile.tool)
    motions = {}
    for share in shares:
        size = size_of(grasp, scenario.membrane.squeeze, motion[::IMAGES], share)
        motions[share] = _moved(seen, scenario, poses(motion, size), size, rng)
    return Run(analysis, None, motions, scenario.membrane.squeeze - light.membrane.squeeze)


def _moved(
    seen: TactilePoses, scenario: IdentificationScenario, way: list[Array], size: float, rng: np.random.Generator
) -> Truth:
    """A motion from a new grasp; images whose membranes the estimator does not tell are counted, not scored."""
    hold = seen.hold
    assert hold is not None
    hold.close(scenario.membrane.squeeze)
    seen.take_grasp(0.0)
    estimates, true, loads = list[RelativePoseEstimate](), list[Array](), list[Array]()
    sliding = list[float]()
    for i, X_CT in enumerate(way):
        estimate = seen.look(X_CT, (i + 1) / (IMAGES * RATE))
        sliding.append(hold.state.sliding_share)
        if estimate.valid and len(estimate.membrane) == 2 and hold.state.converged:
            gas = np.array(list(hold.pressures.values()))
            told = tuple((gas + scenario.grasp.pressure_noise * rng.normal(size=2)).tolist())
            estimates.append(replace(estimate, membrane=SimulatedCell.with_pressure(estimate.membrane, told)))
            true.append(X_CT)
            loads.append(hold.state.wrench.vector())
    share = len(estimates) / len(way)
    return Truth(estimates, None, np.array(true), np.array(loads), float(np.mean(sliding)), size, share)
