# SPDX-License-Identifier: Apache-2.0
"""GelSight-class gels against rendered motion: tools, poses, lamps and errors of the mounts drawn anew each time.

Each draw has a tool of its own at an angle of its own, gels with their own lamps, dots and noise, calibrated by a ball,
and cameras that sit and see a little otherwise than the estimator is told.
"""

import time
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from joblib import delayed

from seed_core.hand import FINGERS, Frame, Hand
from seed_estimation import EstimatorError, PinholeCamera
from seed_estimation.gel.sensor import Gel
from seed_estimation.gel.settings import GelSettings
from seed_estimation.sensors.estimator import SensorEstimator
from seed_estimation.sensors.parameters import SensorEstimatorParameters
from seed_sim.closed_loop.progress import in_parallel
from seed_sim.gel.estimator import PLACES, calibrate_gels
from seed_sim.gel.parameters import GelParameters, gel_hand
from seed_sim.gel.renderer import GelRenderer
from seed_sim.tactile.cameras import mount
from seed_sim.tactile.parameters import ToolShape
from seed_sim.tactile.trajectory import TrajectorySection, poses
from seed_testing.validation.scores import NAMED, Series, scores

MOTION = TrajectorySection(duration=4.0, rate=25.0, translation_mm=(0.4, 0.08, 0.4), rotation_deg=(1.2, 3.0, 1.2))
MOUNT_DEG, MOUNT_MM, FOCAL = 0.3, 0.1, 0.005  # deviations of what the estimator is told wrongly
GOAL = 0.2, 1.0  # [mm], [deg] rms
CASES = {"both": FINGERS, "left alone": ("left",)}


def parameters(rng: np.random.Generator) -> GelParameters:
    """A tool, how it lies in the grasp, and gels."""
    kind = str(rng.choice(("box", "cylinder", "short_handle")))
    length = float(rng.uniform(0.008, 0.011)) if kind == "short_handle" else 0.08
    radius = float(rng.uniform(0.005, 0.014))
    tool = ToolShape(kind=kind, radius=radius, width=float(rng.uniform(0.006, 0.010)), length=length)
    shift = 1e-3 * rng.uniform((-1.5, -0.05, -1.0), (1.5, 0.05, 1.0))
    turn = rng.uniform((-1.0, -90.0, -1.0), (1.0, 90.0, 1.0))
    x, y, z, roll, pitch, yaw = np.concatenate([shift, turn]).tolist()
    return GelParameters(
        tool=tool,
        T_held=Frame((x, y, z), (roll, pitch, yaw)),
        squeeze=float(rng.uniform(0.0005, 0.0009)),
        skirt=float(rng.uniform(0.3, 0.5)),
        creep=float(rng.uniform(0.0, 0.0006)),
        slip=float(rng.uniform(0.0, 0.02)),
        gloss=float(rng.uniform(0.1, 0.5)),
        blur=float(rng.uniform(0.6, 1.2)),
    )  # fmt: skip


def believed(hand: Hand, rng: np.random.Generator) -> Hand:
    """The hand as it is drawn, where it is a little otherwise."""

    def off(frame: Frame) -> Frame:
        x, y, z = (np.array(frame.position) + 1e-3 * MOUNT_MM * rng.standard_normal(3)).tolist()
        roll, pitch, yaw = (np.array(frame.rpy_deg) + MOUNT_DEG * rng.standard_normal(3)).tolist()
        return Frame((x, y, z), (roll, pitch, yaw))

    return replace(hand, C_L=off(hand.C_L), C_R=off(hand.C_R))


def one(seed: int, motion: TrajectorySection = MOTION, places: tuple[int, int] = PLACES) -> dict[str, Any]:
    """Scores of one draw, by case, or the words with which its grasp is refused.

    places: columns and rows of the ball's presses.
    """
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 0x6E1))
    p = parameters(rng)
    renderer = GelRenderer(p, gel_hand(p), seed)
    hand, settings = believed(renderer.hand, rng), GelSettings()
    shadings = calibrate_gels(renderer, settings, seed, places)
    cameras = {f: _with_focal(c, 1.0 + FOCAL * float(rng.standard_normal())) for f, c in renderer.cameras.items()}
    free = [renderer.no_contact(-2.0 + 0.01 * i) for i in range(10)]
    held = [renderer.render(np.eye(4), -0.1 + 0.01 * i) for i in range(5)]
    out: dict[str, Any] = {"seed": seed, "tool": p.tool.kind}
    estimators: dict[str, SensorEstimator[Any]] = {}
    for case, fingers in CASES.items():
        gels = {f: Gel(f, settings, cameras[f], mount(hand, f), shadings[f]) for f in fingers}
        estimator = SensorEstimator(gels, SensorEstimatorParameters(), "gel")
        try:
            estimator.capture_reference(free)
            estimator.initialize_grasp(held)
            estimators[case] = estimator
        except EstimatorError as error:
            out[case] = {"refused": str(error)}
    series = {case: Series() for case in estimators}
    for stamp, X_CT in poses(motion, seed):
        images = renderer.render(X_CT, stamp)
        for case, estimator in estimators.items():
            before = time.process_time()
            estimate = estimator.update(images, stamp)
            series[case].add(X_CT, estimate, 1e3 * (time.process_time() - before))
    return out | {case: scores(s) for case, s in series.items()}


def _with_focal(camera: PinholeCamera, factor: float) -> PinholeCamera:
    """A camera whose focal length is another; the middle stays."""
    K = camera.K * np.array(((factor, 1.0, 1.0), (1.0, factor, 1.0), (1.0, 1.0, 1.0)))
    return PinholeCamera(camera.width, camera.height, K, camera.D, camera.model)


def score_draws(seed: int, draws: int, jobs: int) -> dict[str, Any]:
    """All draws from seed on, and root mean squares over them, by case and axis."""
    each = list(in_parallel([delayed(one)(s) for s in range(seed, seed + draws)], jobs, "draw"))
    out: dict[str, Any] = {"seed": seed, "draws": draws}
    for case in CASES:
        scored = [d[case] for d in each if "refused" not in d[case]]
        out[case] = {"refused": draws - len(scored)}
        if not scored:
            continue
        rmse = np.array([[d["rmse"][name] or np.nan for name in NAMED] for d in scored], float)
        rms = dict(zip(NAMED, np.sqrt(np.nanmean(rmse**2, axis=0)).tolist(), strict=True))
        within = [n for n, v in rms.items() if v <= (GOAL[0] if n.endswith("mm") else GOAL[1])]
        out[case] |= {
            "rms": rms,
            "worst_draw": dict(zip(NAMED, np.nanmax(rmse, axis=0).tolist(), strict=True)),
            "valid_fraction": float(np.mean([d["valid_fraction"] for d in scored])),
            "nees": float(np.mean([d["nees"] for d in scored if d["nees"] is not None])),
            "ms_per_frame": float(np.median([d["ms_per_pair"]["median"] for d in scored])),
            "axes_within_goal": within,
        }
    return out | {"each": each}


def table(result: dict[str, Any]) -> str:
    """For people."""
    lines = [f"gels, {result['draws']} draws from seed {result['seed']}; rms over draws (worst draw)"]
    for case in CASES:
        c = result[case]
        lines.append(f"{case}: {c['refused']} grasps refused")
        if "rms" not in c:
            continue
        lines.append(f"  {100 * c['valid_fraction']:.1f} % valid, {c['ms_per_frame']:.1f} ms CPU a frame, "
                     f"normalised error squared {c['nees']:.1f} (6 expected)")  # fmt: skip
        lines += [f"  {name:9} {c['rms'][name]:7.3f} ({c['worst_draw'][name]:.3f})" for name in NAMED]
        lines.append(f"  within {GOAL[0]:g} mm and {GOAL[1]:g} degree: {len(c['axes_within_goal'])} of 6 axes")
    return "\n".join(lines)
