# SPDX-License-Identifier: Apache-2.0
"""Gross slip with ground truth: the tool slides through the membrane, and the estimator should say so at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import cv2
import numpy as np

from seed_core.spatial import Array, make_pose, so3_exp
from seed_sim.scenario import Scenario
from seed_sim.tactile import TactileRenderer
from seed_sim.validation.run import Progress, estimator_for, tactile_of
from seed_sim.validation.trajectory import TrajectorySection, poses

IN_TIME = 0.1  # [s] from the onset of a slip to its alarm
_SHORTEST = 0.25  # [s] of images after the onset
# ordinary manipulation moves the tool about half as far as the combined trajectory
_ORDINARY = TrajectorySection(translation_mm=(2.2, 1.0, 1.5), rotation_deg=(4.0, 3.0, 3.0))


class Slide(NamedTuple):
    """A slip: from `onset` [s] on the tool slides at `speed` (6,) [rad/s, m/s] through the membrane."""

    onset: float
    speed: Array

    def slid(self, t: float) -> Array:
        """How far (4, 4) at time t."""
        elapsed = max(0.0, t - self.onset)
        return make_pose(so3_exp(self.speed[:3] * elapsed), self.speed[3:] * elapsed)


def random_slide(rng: np.random.Generator, along_z: bool = True) -> Slide:
    """Along x or z at 30 to 100 mm/s, or turning about y at 1 to 3 rad/s; at a random time.

    A rod without features that slides along its own axis, longer than the bubble, changes nothing that a camera could
    see: along_z leaves such slides out.
    """
    speed = np.zeros(6)
    kind = int(rng.integers(0 if along_z else 1, 3))
    sign = float(rng.choice((-1.0, 1.0)))
    if kind == 2:
        speed[1] = sign * rng.uniform(1.0, 3.0)
    else:
        speed[5 if kind == 0 else 3] = sign * rng.uniform(0.03, 0.1)
    return Slide(float(rng.uniform(1.5, 3.0)), speed)


def alarm_delay(scenario: Scenario, seed: int) -> tuple[float | None, bool]:
    """Seconds from onset to alarm (None: none), and whether there was an alarm before the onset."""
    rng = np.random.default_rng((seed, 5))
    p = tactile_of(scenario)
    slide = random_slide(rng, along_z=p.tool.length < 2.0 * p.rim_z)
    renderer = TactileRenderer(tactile_of(scenario), scenario.hand, seed)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    section = replace(_ORDINARY, duration=slide.onset + _SHORTEST + 0.1)
    for stamp, X_held in poses(section, seed):
        X_slid = slide.slid(stamp)
        if estimator.update(renderer.render(X_held @ X_slid, stamp, X_slid), stamp).gross_slip:
            return (stamp - slide.onset, False) if stamp >= slide.onset else (None, True)
    return None, False


def false_alarms(scenario: Scenario, seed: int, minutes: float, progress: Progress | None = None) -> tuple[int, float]:
    """Alarms in so many minutes of ordinary manipulation without slip, and the share of valid estimates.

    The grasp is taken anew after an alarm, as an operator would.
    """
    renderer = TactileRenderer(tactile_of(scenario), scenario.hand, seed)
    estimator = estimator_for(scenario, "rigid_fit", renderer)
    section = replace(_ORDINARY, duration=max(60.0 * minutes, 1.0))
    alarms = valid = frames = 0
    for stamp, X_CT in poses(section, seed):
        estimate = estimator.update(renderer.render(X_CT, stamp), stamp)
        frames, valid = frames + 1, valid + estimate.valid
        if estimate.gross_slip:
            alarms += 1
            estimator = estimator_for(scenario, "rigid_fit", renderer)
        if progress is not None:
            progress(stamp / section.duration)
    return alarms, valid / max(frames, 1)


def alarms(
    scenario: Scenario, seed: int, slips: int, minutes: float, progress: Progress | None = None
) -> dict[str, Any]:
    """Share of slips that raise the alarm within 100 ms, and false alarms."""
    cv2.setNumThreads(1)
    found = [alarm_delay(scenario, 1000 * seed + i) for i in range(slips)]
    delays = sorted(d for d, _ in found if d is not None)
    wrong, valid = false_alarms(scenario, seed, minutes, progress)
    return {
        "scenario": scenario.name,
        "seed": seed,
        "slips": slips,
        "alarm_fraction": sum(d <= IN_TIME for d in delays) / max(slips, 1),
        "alarm_delay_ms": {"median": 1e3 * float(np.median(delays)) if delays else None,
                           "max": 1e3 * delays[-1] if delays else None},
        "early_alarms": sum(early for _, early in found),
        "minutes": minutes,
        "false_alarms": wrong,
        "valid_fraction": valid,
    }  # fmt: skip
