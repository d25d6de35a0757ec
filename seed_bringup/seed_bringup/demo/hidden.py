# SPDX-License-Identifier: Apache-2.0
"""The hidden world of a demo: membranes that nobody is told of, and what the suite's procedure finds out about them."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from seed_bringup.demo.terminal import say
from seed_core.bushing import Stiffness
from seed_core.config import to_mapping
from seed_core.wrench_settings import WrenchSettings
from seed_sim.scenario import Scenario, on_membrane
from seed_sysid.stiffness_map import CHANNELS

if TYPE_CHECKING:
    from seed_sim.identification.truth import Truth
    from seed_sysid.data.dataset import Dataset
    from seed_sysid.fit.analysis import Analysis

SPACING = 0.0065  # [m] of the membranes' nodes: coarse enough for a live cell
HIDDEN = "scenario.yaml"  # what is simulated, in the folder of the results
FOUND = "identification"  # folder of stiffness.yaml, membrane_map.yaml and the procedure's own report


@dataclass(frozen=True)
class Findings:
    """What is believed after the procedures.

    Attributes:
        scenario: of the hidden world, with the grip that the procedure has settled on.
        believed: the scenario as controller and estimator are told of it.
        figures: stiffness, residual and poses, for summary.json.
        words: the same in two or three sentences.
    """

    scenario: Scenario
    believed: Scenario
    figures: dict[str, Any]
    words: str


def hide(scenario: Scenario, seed: int) -> Scenario:
    """The scenario in a hidden world: membranes, weight of the tool, tilt and friction of the table from the seed."""
    from seed_sim.world.cell import true_scenario
    from seed_sim.world.draw import draw_world

    drawn = on_membrane(scenario, seed, firm=True)
    true = true_scenario(drawn, draw_world(seed, "membrane"))
    membrane = replace(drawn.membrane, spacing=SPACING)
    return replace(drawn, membrane=membrane, true_mass=true.true_mass, table=true.table)


def at_camera_rate(scenario: Scenario, rate: float) -> Scenario:
    """The scenario with its membranes solved as often as the live cameras expose; rate [Hz], 0: as often as it says."""
    if not rate:
        return scenario
    return replace(scenario, measurement=replace(scenario.measurement, rate=rate))


def write_scenario(scenario: Scenario, file: Path) -> None:
    """As a file that `load_scenario` reads."""
    head = (
        "# SPDX-License-Identifier: Apache-2.0\n# What was simulated; no other process than the simulation reads it.\n"
    )
    file.write_text(head + yaml.safe_dump(to_mapping(scenario), sort_keys=False), encoding="utf-8")


def find_out(scenario: Scenario, seed: int, folder: Path) -> Findings:
    """Run `./seed identify` on the scenario's own membranes, as its cameras see them, at the grip of the task.

    Where the grasp does not bear the task, the gripper is closed further and the procedure repeated.

    Args:
        scenario: of the hidden world.
        seed: of the sensor's faults and of the images' noise.
        folder: for stiffness.yaml, membrane_map.yaml, samples and report of the procedure.

    Raises:
        SeedError: the procedure ended early, or its data give no map.
    """
    from seed_sim.identification.session import simulate
    from seed_sim.identification.tactile_poses import TactilePoses
    from seed_sim.identification.truth import summary_with_truth
    from seed_sim.world.procedures.identify import membrane_identification_of
    from seed_sim.world.procedures.membranes import closed_until_borne
    from seed_sysid.fit.analysis import analyse
    from seed_sysid.report.results import write_results

    date = datetime.now(UTC).isoformat(timespec="seconds")
    samples = folder / "samples.jsonl"
    grips: list[float] = []  # [m] of imprint, tried so far

    def identify(at: Scenario) -> tuple[Analysis, tuple[Dataset, Truth]]:
        procedure = membrane_identification_of(at)
        if grips:
            say("the grasp does not bear the task: closing the gripper by 2 mm, and identifying again")
            samples.replace(folder / f"samples_at_{1e3 * grips[-1]:.1f}_mm.jsonl")
        grips.append(at.membrane.squeeze)
        say("identifying the grasp on a force/torque sensor, as the cameras see its membranes")
        try:
            data, cell = simulate(procedure, seed, samples, TactilePoses(procedure, seed), date)
        finally:
            print(file=sys.stderr, flush=True)
        return analyse(data, "estimator", procedure.procedure.fit), (data, cell.truth)

    scenario, analysis, (data, truth) = closed_until_borne(scenario, identify)
    figures = summary_with_truth(analysis, truth)
    write_results(folder, analysis, figures, date)
    rest = figures["membrane_map"]["stiffness_at_rest"]
    stiffness = Stiffness.from_vector(np.array(list(rest.values())))
    wrench = WrenchSettings(model="membrane", file=str(folder / "membrane_map.yaml"))
    believed = replace(scenario, grasp=replace(scenario.grasp, believed=stiffness), wrench=wrench)
    share = figures["membrane_map"]["left_out_share"]
    left = figures["membrane_map"]["left_out_rms"]
    found = {"stiffness": rest, "left_out_rms": left, "left_out_share": share, "poses": len(data.samples)}
    return Findings(scenario, believed, found, words_of(found, scenario))


def words_of(found: dict[str, Any], scenario: Scenario) -> str:
    """What was hidden, and what the procedure found of it."""
    kx, ky, kz = (1e-3 * found["stiffness"][axis] for axis in ("x", "y", "z"))
    forces, torques = CHANNELS[3:], CHANNELS[:3]
    worst, turned = (max(found["left_out_share"][c] for c in channels) for channels in (forces, torques))
    left = max(found["left_out_rms"][c] for c in forces)
    return (
        "Hidden from estimator and controller: both membranes (rubber, pressure, friction, dots), the tool's weight "
        "within 3 %, and the table's tilt and friction. "
        f"{found['poses']} poses on a force/torque sensor gave a stiffness of {kx:.2f}, {ky:.2f} and {kz:.2f} N/mm "
        "along x, y and z at rest, and a map from the membranes' motion to the wrench. "
        f"Of poses that it had not seen the map leaves {worst:.1%} of the force unexplained ({left:.2f} N) and "
        f"{turned:.1%} of the torque, on the worst axis each; the tool weighs {scenario.tool_mass:.3f} kg and is taken "
        f"for {scenario.tool.mass:.3f} kg."
    )
