# SPDX-License-Identifier: Apache-2.0
"""A random membrane identified by the suite's own procedure at rest, and then moved on all six axes at once.

What the material does is known from the nodes of the band around the patch, with errors added as an estimator's.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seed_core.estimate import MembraneMotion, RelativePoseEstimate
from seed_core.membrane.material import around, deformation, rigid_motion
from seed_core.spatial import Array, inverse_pose, make_pose, pose_from_rpy, skew, so3_exp
from seed_sim.identification.truth import direction
from seed_sim.membrane import BubbleState, GraspState, MembraneGrasp, random_membrane
from seed_sim.tactile.parameters import ToolShape
from seed_sysid.data.dataset import Dataset, Header, Sample, flat_pose
from seed_sysid.data.membrane_sample import mean_membrane
from seed_sysid.fit.analysis import Analysis, analyse
from seed_sysid.parameters import Procedure
from seed_sysid.run.excitation import designs
from seed_sysid.stiffness_map import wrench_transform
from seed_testing.validation.maps import finite_elements

SPACING = 0.0055  # [m] of nodes, 297 a bubble: the band of 7 mm has two rows of them
STEP = 0.002  # [m] of the tool between solves
SQUEEZES = (-0.0015, 0.0, 0.0015)  # [m] of the grips, from that of the membrane
RADII = (0.009, 0.016)  # [m] of the round handle that is held
DWELL, RATE = 4.0, 10.0  # [s] at each pose; [1/s] frames of the motion
SENSOR_STD = np.repeat([0.003, 0.1], 3) / np.sqrt(6.0)  # of six readings [N m, N]
FRAME_DEG, FRAME = 3.0, 0.005  # [deg], [m] size of the sensor's unknown offset, direction drawn
# Errors of the estimator's MembraneMotion, rms on ten membranes: 200 frames of ./seed validate band --seed 5610
NOISE_TURN, NOISE_SHIFT = np.deg2rad([0.19, 0.07, 0.17]), np.array([7e-5, 8e-5, 4e-5])  # [rad], [m] along x, y, z of C
NOISE_DEFORMATION = 1e-5 * np.array([1.4, 1.7, 0.9, 6.4, 2.2, 5.3, 5.2, 3.5, 1.8])  # [m]
IMAGES = 9.0  # that a sample averages; errors of dots are independent, those of a membrane's motion hardly change
NOISE_PRESSURE = 0.054  # [hPa]
LEAST, MOST = 0.1, 2.0  # times 2 mm and 4 degrees rms: sizes of motions; at 2 the tool turns by 16 degrees at times
TRIES = 5  # of a size of the motion, until as many nodes slide as asked
NEAR = 0.02  # share of sliding nodes that is near enough
COARSE = 3  # of so many frames of a motion one is solved to try a size


@dataclass
class Truth:
    """Frames of a motion: what an estimator would tell, and the load on the tool about T, in T (n, 6)."""

    estimates: list[RelativePoseEstimate]
    elements: Array | None  # (n, 2, 2, 6) change since the grasp of what finite_elements.Watcher tells
    X_CT: Array  # (n, 4, 4) true poses
    wrench: Array
    sliding: float  # mean share of the touching nodes
    size: float  # times 2 mm and 4 degrees rms
    told: float = 1.0  # share of the frames in which the membranes' motion is told; others are not scored


class Run(NamedTuple):
    """A membrane's identification, and motions by the share of the touching nodes that was to slide."""

    analysis: Analysis
    elements: Array | None  # (n, 2, 2, 6) of its samples, as of Truth
    motions: dict[float, Truth]
    closed: float = 0.0  # [m] by which the gripper was closed further, in imprint, until the grasp could be identified


class Watcher:
    """Tells membranes' motions since a grasp as an estimator would, with noise times its usual errors."""

    def __init__(self, grasped: GraspState, noise: float, rng: np.random.Generator) -> None:
        self._band = {f: around(b.nodes.T, b.patch.T) for f, b in grasped.bubbles.items()}
        self._before = {f: b.nodes[self._band[f]].T for f, b in grasped.bubbles.items()}
        self._noise, self._rng = noise, rng

    def motions(self, state: GraspState, ambient: float) -> tuple[MembraneMotion, ...]:
        """Of both fingers; ambient: [Pa]."""
        return tuple(self._motion(f, state.bubbles[f], ambient) for f in self._before)

    def _motion(self, finger: str, bubble: BubbleState, ambient: float) -> MembraneMotion:
        noise = self._noise
        before, after = self._before[finger], bubble.nodes[self._band[finger]].T
        X, middle = rigid_motion(before, after), before.mean(axis=1)
        turn = so3_exp(noise * NOISE_TURN * self._rng.normal(size=3))
        shift = noise * NOISE_SHIFT * self._rng.normal(size=3)
        now = X[:3, :3] @ middle + X[:3, 3]
        error = make_pose(turn, now - turn @ now + shift)  # about the patch
        about = np.eye(6)
        about[3:, :3] = skew(now - X[:3, 3])  # the shift of C's origin that goes with a turn about the patch
        square = noise**2 * np.diag(np.concatenate((NOISE_TURN, NOISE_SHIFT)) ** 2)
        return MembraneMotion(
            finger=finger,
            X_CM=error @ X,
            covariance=about @ square @ about.T,
            deformation=deformation(X, before, after) + noise * NOISE_DEFORMATION * self._rng.normal(size=9),
            centroid=middle,
            pressure=1e-2 * (bubble.pressure + ambient) + noise * NOISE_PRESSURE * self._rng.normal(),
        )


def run_membrane(seed: int, shares: tuple[float, ...], noise: float, frames: int) -> Run:
    """Identify the random membrane of a seed, and move it.

    Args:
        seed: draws membrane, handle, sensor and motion.
        shares: motions in which so many of the touching nodes slide, on average.
        noise: share of the usual errors of the features.
        frames: of each motion.

    Raises:
        SeedError: the membrane cannot be inflated or grasped, or does not fit one spring.
    """
    rng = np.random.default_rng([seed, 0x3A9])
    membrane = replace(random_membrane(seed, SPACING), step=STEP)
    grasp = MembraneGrasp(membrane, ToolShape(radius=float(rng.uniform(*RADII))))
    dots = finite_elements.Watcher(grasp, noise, np.random.default_rng([seed, 0xFE]))
    procedure, samples, elements = Procedure(), list[Sample](), list[Array]()
    offset = make_pose(so3_exp(np.deg2rad(FRAME_DEG) * direction(rng)), FRAME * direction(rng))
    to_sensor = wrench_transform(offset)
    for grip, (targets, more) in enumerate(zip(designs(procedure), SQUEEZES, strict=True)):
        watcher = Watcher(closed := grasp.close(membrane.squeeze + more), noise, rng)
        first = dots.seen(closed, IMAGES)
        for i, target in enumerate(targets):
            state = grasp.solve(inverse_pose(target.X_TC), DWELL * i)
            if not state.converged:
                continue
            load = to_sensor @ state.wrench.vector() + SENSOR_STD * rng.normal(size=6)
            seen = watcher.motions(state, membrane.ambient)
            elements.append(dots.seen(state, IMAGES) - first)
            samples.append(
                Sample(
                    name=target.name,
                    kind=target.kind,
                    grip=grip,
                    stamp=DWELL * len(samples),
                    kinematic=flat_pose(target.X_TC),
                    wrench=tuple(load.tolist()),
                    pressures=tuple(m.pressure for m in seen),
                    width=procedure.widths[grip],
                    settle=2.0,
                    readings=6,
                    membrane=mean_membrane([seen]),
                )
            )
    analysis = analyse(Dataset(Header(hand="membrane", tool="handle", created=""), samples), "kinematic")
    motion = combined_motion(rng, frames)
    motions = {s: move(grasp, membrane.squeeze, motion, s, noise, rng, dots) for s in shares}
    return Run(analysis, np.array(elements), motions)


def move(
    grasp: MembraneGrasp,
    squeeze: float,
    motion: Array,
    share: float,
    noise: float,
    rng: np.random.Generator,
    dots: finite_elements.Watcher,
) -> Truth:
    """A motion (n, 6) from a new grasp, made so large that a share of the touching nodes slides on average."""
    size = size_of(grasp, squeeze, motion, share)
    ambient = grasp.parameters.ambient
    watcher = Watcher(closed := grasp.close(squeeze), noise, rng)
    first = dots.seen(closed, IMAGES)
    estimates, elements, true, loads, sliding = [], [], [], [], []
    for i, X_CT in enumerate(poses(motion, size)):
        state = grasp.solve(X_CT, i / RATE)
        if not state.converged:
            continue
        estimates.append(RelativePoseEstimate(i / RATE, X_CT, membrane=watcher.motions(state, ambient)))
        elements.append(dots.seen(state) - first)
        true.append(X_CT)
        loads.append(state.wrench.vector())
        sliding.append(state.sliding_share)
    return Truth(estimates, np.array(elements), np.array(true), np.array(loads), float(np.mean(sliding)), size)


def size_of(grasp: MembraneGrasp, squeeze: float, motion: Array, share: float) -> float:
    """How large a motion (n, 6) at RATE must be, times itself, for a share of the touching nodes to slide."""
    low, high, size = LEAST, MOST, share
    for _ in range(TRIES):
        grasp.close(squeeze)
        coarse = [grasp.solve(X, i / RATE) for i, X in enumerate(poses(motion, size)) if i % COARSE == 0]
        slides = float(np.mean([s.sliding_share for s in coarse if s.converged]))
        if abs(slides - share) < NEAR:
            break
        low, high = (size, high) if slides < share else (low, size)
        guess = size * (share / max(slides, 0.05)) ** 1.5
        size = guess if low < guess < high else 0.5 * (low + high)
    return size


def combined_motion(rng: np.random.Generator, frames: int, rate: float = RATE) -> Array:
    """(frames, 6) [rad, m] from the grasp on: three slow waves on each axis, 2 mm and 4 degrees rms."""
    t = np.arange(frames) / rate
    frequency, phase = rng.uniform(0.05, 0.25, (6, 3, 1)), rng.uniform(0.0, 2.0 * np.pi, (6, 3, 1))
    waves = np.sin(2.0 * np.pi * frequency * t + phase).sum(axis=1)
    waves -= waves[:, :1] * np.exp(-t)
    return np.asarray((waves / waves.std(axis=1, keepdims=True)).T * np.repeat([np.deg2rad(4.0), 2e-3], 3))


def poses(motion: Array, size: float) -> list[Array]:
    """X_CT (4, 4) of a motion (n, 6) times size."""
    return [pose_from_rpy(v[:3], v[3:]) for v in size * motion]
