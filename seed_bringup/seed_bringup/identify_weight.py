# SPDX-License-Identifier: Apache-2.0
"""./seed identify --procedure weight: the stiffness of a grasp by a known weight, from a recording or simulated."""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.bushing import Model
from seed_core.errors import SeedError
from seed_core.hand import FINGERS, read_hand
from seed_core.membrane.features import by_finger
from seed_core.program.files import write_text
from seed_core.spatial import inverse_pose
from seed_core.stiffness_file import save_stiffness
from seed_sim.identification.scenario import identify_on_membrane, load
from seed_sim.identification.weight import identify_with_weight
from seed_sysid.data.held_weight import LEAST, SETTLE, Attitude, attitudes
from seed_sysid.fit.weight import MINIMUM, WeightError, fit_weight
from seed_sysid.membrane.weights import WeightSlopes, fit_weights
from seed_sysid.report.weight import (
    slope_figures,
    slope_lines,
    split_known,
    stiffness_lines,
    weight_picture,
    weight_stiffness_file,
)

Answer = tuple[str, dict[str, Any], bool]  # in words, as plain data, and whether all six axes are known


def recorded(path: Path, hand_file: str, model: Model, folder: Path | None) -> Answer:
    """The stiffness by a recording of a hand that was turned with a known tool in it.

    Args:
        path: of a bag.
        hand_file: of estimator and controller, with the tool's mass and centre of mass.
        model: of the stiffness map.
        folder: for stiffness.yaml, weight.svg and summary.json; None leaves nothing.

    Raises:
        SeedError: the recording tells nothing, or the tool slid.
    """
    hand, tool = read_hand(hand_file)
    recording = import_module("seed_bringup.ros.held_recording").read_recording(path)  # ROS, only where it is needed
    rests = attitudes(recording.arm, recording.estimates, hand, tool)
    if len(rests) < MINIMUM:
        raise SeedError(
            f"{path}: the hand rested in {len(rests)} attitudes with valid poses of the tool, {MINIMUM} are the least: "
            f"hold it still in each for {SETTLE + LEAST:g} s or more, with the tool free"
        )
    X_TC, loads = np.array([inverse_pose(r.X_CP) for r in rests]), np.array([r.wrench_of_patches for r in rests])
    fit = fit_weight(X_TC, loads, model)
    slopes = _slopes([r for i, r in enumerate(rests) if i not in fit.left_out])
    figures: dict[str, Any] = {
        "procedure": "weight",
        "from": str(path),
        "tool": tool.name,
        "mass": tool.mass,
        "orientations": len(rests),
        "images": sum(r.images for r in rests),
        "stiffness": split_known(fit.stiffness),
        "std": split_known(fit.std),
        "undetermined": fit.undetermined,
        "left_out": [rests[i].stamp - recording.arm[0][0] for i in fit.left_out],
        "membrane_slopes": None if slopes is None else slope_figures(slopes),
    }
    lines = [f"stiffness by the weight of '{tool.name}', {tool.mass:g} kg, in {len(rests)} attitudes, 95 % intervals:"]
    lines += stiffness_lines(fit)
    if fit.left_out:
        when = ", ".join(f"{t:.1f} s" for t in figures["left_out"])
        lines.append(
            f"left out, since something else bore or loaded the tool: the rests {when} after the first pose of the arm"
        )
    if slopes is not None:
        lines += ["load over the motion of the membranes' material, 95 % intervals:", *slope_lines(slopes)]
    if fit.undetermined:
        lines.append(
            "no stiffness.yaml, which wants all six axes: what is known goes into `grasp` of the hand file; a centre "
            "of mass on a lever tells of more axes"
        )
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        if not fit.undetermined:
            now = datetime.now(UTC).isoformat(timespec="seconds")
            file = weight_stiffness_file(fit, hand.name, tool.name, now, recording.width, recording.pressure, model)
            save_stiffness(folder / "stiffness.yaml", file)
        write_text(folder / "weight.svg", weight_picture(X_TC, loads, fit, model))
        write_text(folder / "summary.json", json.dumps(figures, indent=1) + "\n")
        lines.append(f"left in {folder}: {', '.join(sorted(f.name for f in folder.iterdir()))}")
    return "\n".join(lines), figures, not fit.undetermined


def _slopes(rests: Sequence[Attitude]) -> WeightSlopes | None:
    """None where the membranes are not told of, or tell nothing."""
    told = [r for r in rests if len(r.membrane) == len(FINGERS)]
    if not told or any(m.centroid is None for r in told for m in r.membrane):
        return None
    motions = [by_finger([m.estimate for m in r.membrane]) for r in told]
    middles = np.array([m.centroid for m in motions[0]])
    try:
        return fit_weights(motions, middles, np.array([r.X_CT for r in told]), np.array([r.wrench for r in told]))
    except WeightError:
        return None


def simulated(name: str, seed: int, model: Model | None) -> Answer:
    """By the weight of an identification scenario, from true poses with noise."""
    scenario = load(name)
    fit, figures = identify_with_weight(scenario, seed, model or scenario.procedure.fit.model)
    truth = np.concatenate([figures["truth"]["rotation"], figures["truth"]["translation"]])
    held = f"a weight of {scenario.weight.mass:g} kg in {figures['orientations']} orientations"
    lines = [f"stiffness from {held}, 95 % intervals:"]
    return "\n".join(lines + stiffness_lines(fit, truth)), figures, True


def simulated_on_membranes(name: str, membrane: int, seed: int) -> Answer:
    """By the weight of an identification scenario, whose tool hangs between random membranes, as images show it."""
    from seed_sim.identification.membrane_weight import identify_membranes_with_weight

    scenario = identify_on_membrane(load(name), membrane)
    found, figures = identify_membranes_with_weight(scenario, seed)
    lighter = figures["lighter"]
    lines = [
        "load over the motion of the membranes' material, 95 % intervals, from a weight of "
        f"{scenario.weight.mass:g} kg in {figures['attitudes']} attitudes:",
        *slope_lines(found),
        f"a lighter weight, up to {lighter['load']:.1f} N, is told to {lighter['off']:.2f} N rms by them",
        found.caveats[-1],
    ]
    return "\n".join(lines), figures, True
