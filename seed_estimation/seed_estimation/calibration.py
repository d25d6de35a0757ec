# SPDX-License-Identifier: Apache-2.0
"""Calibration of a hand's cameras: how wrong their range is, and where they sit. docs/estimation.md walks through it.

    ./seed calibrate CAPTURE.npz --out calibration.yaml [--membrane membrane.yaml] [--radius 0.012]

CAPTURE.npz holds per finger (left, right): `<finger>_K` (3, 3), `<finger>_D` (5,), `<finger>_no_contact` (n, H, W)
depth [m] of the membrane touching nothing, and `<finger>_grasped` (k, H, W) mean depth of a cylinder held in k poses
(at least three, tilted by 10 to 20 degrees against each other).

Range: the membrane's shape at rest is known, so the smooth part of (known - measured) depth is the correction.
Extrinsics: each camera sees one side of the cylinder; the axes that both sides tell must be one line in every pose.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.optimize import least_squares

from seed_core.config import ConfigError, field, load_file, to_mapping
from seed_core.errors import SeedError
from seed_core.hand import Frame, Hand
from seed_core.spatial import Array, make_pose, rpy_from_rotation, so3_exp
from seed_estimation.camera import Camera
from seed_estimation.contact_patch import PatchFinder, mean_depth
from seed_estimation.images import Image
from seed_estimation.parameters import EstimatorParameters
from seed_estimation.surface import smooth_depth, touches

STEP = 8  # [px] between the nodes of the stored range offset
SMOOTH = 4.0  # [px] the range error is smooth; what is finer is the camera's pattern, which averages out
PRIOR = np.array([0.05] * 3 + [0.005] * 3)  # [rad], [m] how wrong a drawing of a hand may be
# Deviations of one cylinder's axis as one camera sees it: its place [m], its direction turned about x, y, z of C [rad].
# A turn about the optical axis (y) shows on the cylinder's flanks only.
GAP, TURN = 1e-4, np.array((2.5e-3, 8e-3, 8e-3))


@dataclass(frozen=True)
class MembraneShape:
    """The membrane at rest: half an ellipsoid over an elliptical rim, its apex on the optical axis."""

    rim_x: float = field(0.057, unit="m", low=0.005, high=0.5, doc="semi-axis along the image's rows")
    rim_y: float = field(0.040, unit="m", low=0.005, high=0.5, doc="semi-axis along the image's columns")
    height: float = field(0.030, unit="m", low=0.001, high=0.5, doc="of the apex over the rim")
    apex: float = field(0.0995, unit="m", low=0.01, high=1.0, doc="distance of the apex from the camera")

    def depth(self, camera: Camera) -> Image:
        """Depth (H, W) [m] that the camera would see; NaN beside the dome."""
        d = camera.rays() / np.array((self.rim_x, self.rim_y, self.height))
        rim = self.apex - self.height
        o = np.array((0.0, 0.0, -rim / self.height))
        a, b, c = (d * d).sum(-1), d @ o, float(o @ o) - 1.0
        root = b * b - a * c
        with np.errstate(invalid="ignore"):
            z = (-b + np.sqrt(root)) / a
            return np.where(z >= rim, z, np.nan).astype(np.float32)


@dataclass(frozen=True)
class FingerCalibration:
    """One camera: its pose in C, and its range offset on a grid of every STEP-th pixel."""

    pose: Frame = field(doc="optical frame in C")
    width: int = field(low=8, high=4096, unit="px")
    height: int = field(low=8, high=4096, unit="px")
    range_offset: list[list[float]] = field(
        [], unit="m", low=-0.05, high=0.05, doc="true minus measured; rows by columns"
    )

    def __post_init__(self) -> None:
        wanted = (-(-self.height // STEP), -(-self.width // STEP))
        shape = (len(self.range_offset), len(self.range_offset[0]) if self.range_offset else 0)
        if self.range_offset and (shape != wanted or any(len(r) != wanted[1] for r in self.range_offset)):
            raise ConfigError(
                f"range_offset has {shape} nodes; an image of {self.width} x {self.height} needs {wanted}"
            )

    def offset_map(self) -> Image:
        """(H, W) [m]; zero where none was calibrated."""
        if not self.range_offset:
            return np.zeros((self.height, self.width), np.float32)
        v, u = np.mgrid[: self.height, : self.width].astype(np.float32) / np.float32(STEP)
        grid = np.asarray(self.range_offset, np.float32)
        return np.asarray(cv2.remap(grid, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)


@dataclass(frozen=True)
class Calibration:
    """What `./seed calibrate` writes and the estimator loads."""

    fingers: dict[str, FingerCalibration] = field({}, doc="left, right")

    def hand(self, hand: Hand) -> Hand:
        """The hand with the calibrated camera poses."""
        for finger in ("left", "right"):
            if finger in self.fingers:
                pose = self.fingers[finger].pose
                hand = replace(hand, C_L=pose) if finger == "left" else replace(hand, C_R=pose)
        return hand

    def range_offsets(self) -> dict[str, Image]:
        """Offset map (H, W) [m] of each finger that has one."""
        return {name: one.offset_map() for name, one in self.fingers.items() if one.range_offset}


def load(path: str | Path) -> Calibration:
    """Raises ConfigError with file and line."""
    return load_file(path, Calibration)


def save(calibration: Calibration, path: Path) -> None:
    """As YAML."""
    path.write_text(yaml.safe_dump(to_mapping(calibration), sort_keys=False, default_flow_style=None), encoding="utf-8")


def range_offset(measured: Image, known: Image) -> list[list[float]]:
    """Nodes of the smooth part of known - measured depth, both (H, W) [m] with NaN where there is none.

    Raises:
        SeedError: the two hardly overlap.
    """
    difference = known - measured
    valid = np.isfinite(difference) & (np.abs(difference) < 0.04)
    if valid.mean() < 0.2:
        raise SeedError(
            f"only {valid.mean():.0%} of the image show the known membrane (20 % needed): check its shape and distance"
        )
    smooth = smooth_depth(np.where(valid, difference, 0.0).astype(np.float32), valid, SMOOTH)
    fill = smooth_depth(np.where(valid, difference, 0.0).astype(np.float32), valid, 10 * SMOOTH)
    whole = np.where(np.isfinite(smooth), smooth, np.where(np.isfinite(fill), fill, np.median(difference[valid])))
    return [[round(float(v), 6) for v in row] for row in whole[::STEP, ::STEP]]


def cylinder_axis(points: Array, radius: float) -> tuple[Array, Array]:
    """A point on the axis and its direction (3,), both in the camera's frame, of a cylinder seen as points (N, 3) [m].

    Raises:
        SeedError: too few points, or they are no such cylinder to 2 mm.
    """
    if len(points) < 100:
        raise SeedError(f"{len(points)} pixels show the cylinder; at least 100 are needed: grasp it more firmly")
    centre = points.mean(axis=0)
    _, _, Vt = np.linalg.svd(points - centre, full_matrices=False)
    d0 = Vt[0] if abs(Vt[0][2]) < 0.8 else Vt[1]
    across = np.cross(d0, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    into = np.cross(across, d0)
    into *= np.sign(into[2])

    def line(q: Array) -> tuple[Array, Array]:
        d = d0 + q[0] * across + q[1] * into
        return centre + q[2] * across + (radius + q[3]) * into, d / np.linalg.norm(d)

    def residual(q: Array) -> Array:
        a, d = line(q)
        offset = points - a
        return np.asarray((np.linalg.norm(offset - np.outer(offset @ d, d), axis=1) - radius) * 1e3)

    found = least_squares(residual, np.zeros(4), loss="soft_l1")
    if not np.sqrt(np.mean(found.fun**2)) < 2.0:
        raise SeedError(
            f"the points fit a cylinder of {radius * 1e3:g} mm to {np.sqrt(np.mean(found.fun**2)):.1f} mm rms only"
        )
    return line(found.x)


def extrinsics(
    left: Sequence[tuple[Array, Array]], right: Sequence[tuple[Array, Array]], X_CL: Array, X_CR: Array
) -> tuple[Array, Array]:
    """X_CL, X_CR (4, 4), corrected by equal and opposite steps that make both cameras' axes of each pose one line."""

    def corrected(q: Array) -> tuple[Array, Array]:
        half = 0.5 * q * PRIOR
        return make_pose(so3_exp(half[:3]), half[3:]) @ X_CL, make_pose(so3_exp(-half[:3]), -half[3:]) @ X_CR

    def residual(q: Array) -> Array:
        A, B = corrected(q)
        out = [q]  # the drawing counts where nothing else tells
        for (a, d), (b, e) in zip(left, right, strict=True):
            a_C, d_C = A[:3, :3] @ a + A[:3, 3], A[:3, :3] @ d
            b_C, e_C = B[:3, :3] @ b + B[:3, 3], B[:3, :3] @ e
            gap = b_C - a_C
            out += [(gap - (gap @ d_C) * d_C) / GAP, np.cross(d_C, e_C) / TURN]
        return np.concatenate(out)

    return corrected(least_squares(residual, np.zeros(6)).x)


def calibrate(
    cameras: Mapping[str, Camera],
    no_contact: Mapping[str, Sequence[Image]],
    grasped: Mapping[str, Sequence[Image]],
    shape: MembraneShape | Mapping[str, Image],
    radius: float,
    hand: Hand,
    parameters: EstimatorParameters | None = None,
) -> Calibration:
    """Range offset and camera poses of each finger; shape: of the membrane, or its known depth image by finger.

    Raises:
        SeedError: the captures do not show what they should.
    """
    p = replace(parameters or EstimatorParameters(), near=0.03, far=0.15)
    X, lines, nodes = {"left": hand.X_CL, "right": hand.X_CR}, {}, {}
    for finger, camera in cameras.items():
        known = shape.depth(camera) if isinstance(shape, MembraneShape) else shape[finger]
        measured, _ = mean_depth(no_contact[finger], p.near, p.far)
        nodes[finger] = range_offset(measured, known)
        one = FingerCalibration(Frame(), camera.width, camera.height, nodes[finger])
        offset = one.offset_map()
        finder = PatchFinder(finger, camera, X[finger], [f + offset for f in no_contact[finger]], p)
        lines[finger] = [_axis(finder, frame + offset, radius) for frame in grasped.get(finger, ())]
    if len(cameras) == 2 and min(len(v) for v in lines.values()) >= 3:
        X["left"], X["right"] = extrinsics(lines["left"], lines["right"], X["left"], X["right"])
    return Calibration({f: FingerCalibration(frame_of(X[f]), c.width, c.height, nodes[f]) for f, c in cameras.items()})


def _axis(finder: PatchFinder, depth: Image, radius: float) -> tuple[Array, Array]:
    """The cylinder's axis from the pixels where the membrane lies on it; which those are, its axis tells."""
    depth = depth + finder.correction
    mask, patch = finder.find(depth)
    if not patch.in_contact:
        raise SeedError(f"{finder.finger}: a capture of the grasped cylinder shows no contact")
    smooth = smooth_depth(depth, np.isfinite(depth) & (mask > 0), 1.0)
    seen = (finder.core(depth, mask) > 0) & np.isfinite(smooth)
    points, rest = finder.camera.back_project(smooth, seen), finder.rest[seen]
    line = cylinder_axis(points, radius)
    for _ in range(3):
        a, d = line
        offset = points - a
        outward = offset - np.outer(offset @ d, d)
        n = (outward / np.linalg.norm(outward, axis=1, keepdims=True)).T.astype(np.float32)
        on = touches(rest, points[:, 2].astype(np.float32), n, finder.parameters.decay)
        line = cylinder_axis(points[on], radius)
    return line


def frame_of(X: Array) -> Frame:
    """A pose (4, 4) as position and angles."""
    rpy = np.rad2deg(rpy_from_rotation(X[:3, :3]))
    p = X[:3, 3]
    return Frame((float(p[0]), float(p[1]), float(p[2])), (float(rpy[0]), float(rpy[1]), float(rpy[2])))


def _read(path: Path) -> tuple[dict[str, Camera], dict[str, Any], dict[str, Any]]:
    cameras, still, held = {}, {}, {}
    try:
        with np.load(path, allow_pickle=False) as data:
            for finger in ("left", "right"):
                if f"{finger}_no_contact" in data:
                    still[finger] = list(np.asarray(data[f"{finger}_no_contact"], np.float32))
                    held[finger] = (
                        list(np.asarray(data[f"{finger}_grasped"], np.float32)) if f"{finger}_grasped" in data else []
                    )
                    h, w = still[finger][0].shape
                    cameras[finger] = Camera(w, h, data[f"{finger}_K"], data[f"{finger}_D"])
    except (OSError, KeyError, ValueError, IndexError) as error:
        raise SeedError(f"{path}: not a capture for calibration: {error}") from error
    if not cameras:
        raise SeedError(f"{path}: neither left_no_contact nor right_no_contact in it")
    return cameras, still, held


def main(argv: list[str] | None = None) -> int:
    """Exit code 0 when the calibration was written."""
    parser = argparse.ArgumentParser(
        prog="seed calibrate", description="Calibrate range and pose of the bubbles' cameras."
    )
    parser.add_argument("capture", type=Path, help="npz with depth images; see docs/estimation.md")
    parser.add_argument("--out", type=Path, default=Path("calibration.yaml"))
    parser.add_argument("--membrane", type=Path, help="YAML of the membrane's shape: rim_x, rim_y, height, apex")
    parser.add_argument("--hand", type=Path, help="YAML of the hand; without it the default one")
    parser.add_argument("--radius", type=float, default=0.012, help="of the grasped cylinder [m]")
    options = parser.parse_args(sys.argv[1:] if argv is None else argv)
    try:
        shape = load_file(options.membrane, MembraneShape) if options.membrane else MembraneShape()
        hand = load_file(options.hand, Hand) if options.hand else Hand()
        cameras, still, held = _read(options.capture)
        calibration = calibrate(cameras, still, held, shape, options.radius, hand)
        save(calibration, options.out)
    except (SeedError, OSError) as error:
        print(f"seed calibrate: {error}", file=sys.stderr)
        return 2
    for finger, one in calibration.fingers.items():
        median = float(np.median(one.offset_map())) * 1e3
        print(
            f"{finger}: range offset median {median:.1f} mm; camera at {np.round(one.pose.position, 4)} m, "
            f"rpy {np.round(one.pose.rpy_deg, 2)} deg"
        )
    print(f"written to {options.out}; set the estimator's parameter `calibration` to it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
