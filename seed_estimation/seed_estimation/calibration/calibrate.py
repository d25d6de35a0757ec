# SPDX-License-Identifier: Apache-2.0
"""Calibration of a hand's cameras: their range error and their poses. docs/how_to/calibrate.md walks through it.

    ./seed calibrate CAPTURE.npz --out calibration.yaml [--membrane membrane.yaml] [--radius 0.012]

`./seed capture` makes CAPTURE.npz. It holds per finger (left, right): `<finger>_K` (3, 3), `<finger>_D` (5,),
`<finger>_model` of the distortion (plumb_bob without it), `<finger>_no_contact` (n, H, W) depth [m] of the membrane
touching nothing, and `<finger>_grasped` (k, H, W) mean depth of a cylinder held in k poses (at least three, tilted by
10 to 20 degrees against each other).

Range: the membrane's shape at rest is known, so known - measured depth is the correction; its smooth part is stored.
Extrinsics: each camera sees one side of the cylinder; the axes that both sides tell must be one line in every pose.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from seed_core.config import field, load_file
from seed_core.errors import SeedError
from seed_core.hand import FINGERS, Hand, read_hand
from seed_core.program.command_line import Parser, command, number
from seed_core.program.npz import read_npz
from seed_core.spatial import Array, so3_log
from seed_estimation.calibration.cylinder import Line, extrinsics, seen_axis
from seed_estimation.calibration.file import STEP, Calibration, FingerCalibration, frame_of, save
from seed_estimation.contact.membrane import Membrane, mean_depth, membrane_at_rest
from seed_estimation.contact.surface import smooth_depth
from seed_estimation.images.camera import PinholeCamera
from seed_estimation.images.tactile_images import Image
from seed_estimation.parameters import EstimatorParameters

SMOOTH = 2.0  # [px] of the stored correction; what is finer is taken out of every reference anyway
FILL = 40.0  # [px] blur of what stands in for pixels without depth
# How well the cylinder tells the cameras' poses to each other at best, per axis: docs/how_to/calibrate.md
MUTUAL_ROTATION_STD, MUTUAL_POSITION_STD = 0.0012, 0.00015  # [rad], [m]
LEAST_TURN = np.deg2rad(8.0)  # [rad] between the cylinder's axes of two poses, in one camera at least
NEAR, FAR = 0.03, 0.15  # [m] of a membrane; an uncalibrated range reads up to 20 mm far

PARAMETERS = replace(EstimatorParameters(), near=NEAR, far=FAR)


@dataclass(frozen=True)
class MembraneShape:
    """The membrane at rest: half an ellipsoid over an elliptical rim, its apex on the optical axis."""

    rim_x: float = field(0.057, unit="m", low=0.005, high=0.5, doc="semi-axis along the image's rows")
    rim_y: float = field(0.040, unit="m", low=0.005, high=0.5, doc="semi-axis along the image's columns")
    height: float = field(0.030, unit="m", low=0.001, high=0.5, doc="of the apex over the rim")
    apex: float = field(0.0995, unit="m", low=0.01, high=1.0, doc="distance of the apex from the camera")

    def depth(self, camera: PinholeCamera) -> Image:
        """Depth (H, W) [m] that the camera would see; NaN beside the dome."""
        d = camera.rays / np.array((self.rim_x, self.rim_y, self.height))
        rim = self.apex - self.height
        o = np.array((0.0, 0.0, -rim / self.height))
        a, b, c = (d * d).sum(-1), d @ o, float(o @ o) - 1.0
        root = b * b - a * c
        with np.errstate(invalid="ignore"):
            z = (-b + np.sqrt(root)) / a
            return np.where(z >= rim, z, np.nan).astype(np.float32)


def calibrate(
    cameras: Mapping[str, PinholeCamera],
    no_contact: Mapping[str, Sequence[Image]],
    grasped: Mapping[str, Sequence[Image]],
    shape: MembraneShape,
    radius: float,
    hand: Hand,
) -> Calibration:
    """Range offset of each finger, and the cameras' poses.

    Args:
        cameras: by finger.
        no_contact: depth images (H, W) [m] of the membrane touching nothing.
        grasped: mean depth of the cylinder, one per pose; no camera poses are found with fewer than three.
        shape: of the membrane.
        radius: of the cylinder [m].
        hand: as drawn.

    Raises:
        SeedError: the captures do not show what they should.
    """
    X, lines, nodes = {"left": hand.X_CL, "right": hand.X_CR}, {}, {}
    for finger, camera in cameras.items():
        offset, membrane = at_rest(finger, camera, X[finger], no_contact[finger], shape)
        smooth = smooth_depth(offset, np.ones(offset.shape, bool), SMOOTH)
        nodes[finger] = [[round(float(v), 6) for v in row] for row in smooth[::STEP, ::STEP]]
        lines[finger] = [seen_axis(membrane, frame + offset, radius, PARAMETERS) for frame in grasped.get(finger, ())]
    fingers = {f: FingerCalibration(c.width, c.height, nodes[f]) for f, c in cameras.items()}
    poses = {f: len(seen) for f, seen in lines.items()}
    if len(set(poses.values())) > 1:
        told = ", ".join(f"{f} {n}" for f, n in poses.items())
        raise SeedError(f"poses of the cylinder in the capture: {told}; each must be before both cameras: capture anew")
    if len(cameras) < 2 or min(poses.values()) < 3:
        return Calibration(fingers)
    _refuse_alike(lines)
    left, right, std = extrinsics(lines["left"], lines["right"], X["left"], X["right"])
    found = {"left": left, "right": right}
    drawn = {"left": hand.C_L, "right": hand.C_R}
    fingers = {f: replace(one, pose=frame_of(found[f]), drawn=drawn[f]) for f, one in fingers.items()}
    rotation, position = (round(float(np.sqrt(np.mean(part**2))), 6) for part in (std[:3], std[3:]))
    return Calibration(fingers, max(rotation, MUTUAL_ROTATION_STD), max(position, MUTUAL_POSITION_STD))


def _refuse_alike(lines: Mapping[str, Sequence[Line]]) -> None:
    """Raises SeedError where the cylinder lies alike in all poses: nothing tells how the cameras lie along it."""
    turned = max(a.angle(b) for seen in lines.values() for a, b in combinations(seen, 2))
    if turned < LEAST_TURN:
        raise SeedError(
            f"the cylinder lies alike in all poses, within {np.rad2deg(turned):.1f} degrees (at least "
            f"{np.rad2deg(LEAST_TURN):.0f}): capture anew, and tilt it by 10 to 20 degrees between the poses"
        )


def at_rest(
    finger: str, camera: PinholeCamera, X_CX: Array, frames: Sequence[Image], shape: MembraneShape
) -> tuple[Image, Membrane]:
    """Range error (H, W) [m] of every pixel, for a fixed pattern would tilt an axis, and the membrane without it.

    Args:
        X_CX: (4, 4) pose of the camera, as drawn.
        frames: depth (H, W) [m] of the membrane touching nothing.

    Raises:
        SeedError: they do not show the membrane.
    """
    measured, _ = mean_depth(frames, NEAR, FAR)
    offset = range_error(measured, shape.depth(camera))
    return offset, membrane_at_rest(finger, camera, X_CX, [f + offset for f in frames], PARAMETERS)


def range_error(measured: Image, known: Image) -> Image:
    """known - measured depth (H, W) [m], smooth where there is none.

    Raises:
        SeedError: the two hardly overlap.
    """
    difference = known - measured
    valid = np.isfinite(difference) & (np.abs(difference) < 0.04)
    if valid.mean() < 0.2:
        raise SeedError(
            f"only {valid.mean():.0%} of the image show the known membrane (20 % needed): check its shape and distance"
        )
    fill = smooth_depth(np.where(valid, difference, 0.0).astype(np.float32), valid, FILL)
    rest = np.where(np.isfinite(fill), fill, np.median(difference[valid]))
    return np.asarray(np.where(valid, difference, rest), np.float32)


Captures = dict[str, list[Image]]  # depth images by finger


def read_capture(path: Path) -> tuple[dict[str, PinholeCamera], Captures, Captures]:
    """Cameras, images without contact and images of the grasped cylinder, by finger.

    Raises:
        SeedError: the file is no capture.
    """
    cameras, no_contact, grasped = {}, {}, {}
    data = read_npz(path, "not a capture for calibration")
    try:
        for finger in FINGERS:
            if f"{finger}_no_contact" in data:
                no_contact[finger] = list(np.asarray(data[f"{finger}_no_contact"], np.float32))
                h, w = no_contact[finger][0].shape
                model = str(data.get(f"{finger}_model", "plumb_bob"))
                cameras[finger] = PinholeCamera(w, h, data[f"{finger}_K"], data[f"{finger}_D"], model)
                if f"{finger}_grasped" in data:
                    grasped[finger] = list(np.asarray(data[f"{finger}_grasped"], np.float32))
                    if other := {image.shape for image in grasped[finger]} - {(h, w)}:
                        raise ValueError(f"images in {finger}_grasped have shape {other.pop()}, free ones {(h, w)}")
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise SeedError(f"{path}: not a capture for calibration: {error}") from error
    if not cameras:
        raise SeedError(f"{path}: neither left_no_contact nor right_no_contact in it")
    return cameras, no_contact, grasped


def table(calibration: Calibration, drawn: Hand) -> str:
    """What each camera was off by, for people: range [mm], and pose against the drawing [mm], [deg], in C."""
    X_CX = {"left": drawn.X_CL, "right": drawn.X_CR}
    found = calibration.hand(drawn)
    X_found = {"left": found.X_CL, "right": found.X_CR}
    lines = ["finger   range, true - measured [mm]     camera off its drawing: x, y, z [mm]   about x, y, z [deg]"]
    for finger, one in calibration.fingers.items():
        low, middle, high = 1e3 * np.percentile(one.offset_map(), (5, 50, 95))
        shift = 1e3 * (X_found[finger][:3, 3] - X_CX[finger][:3, 3])
        turn = np.rad2deg(so3_log(X_found[finger][:3, :3] @ X_CX[finger][:3, :3].T))
        moved, turned = (" ".join(f"{v + 0.0:6.2f}" for v in np.round(values, 2)) for values in (shift, turn))
        lines.append(f"{finger:8s} {middle:5.1f} (90 %: {low:5.1f} to {high:5.1f})      {moved:>38s}   {turned}")
    if not calibration.mutual_position_std:
        return "\n".join(
            [*lines, "camera poses are as drawn: they need three poses of the cylinder before both cameras"]
        )
    rotation, position = np.rad2deg(calibration.mutual_rotation_std), 1e3 * calibration.mutual_position_std
    lines.append(
        f"the cameras' poses to each other are known to {position:.2f} mm and {rotation:.2f} degrees on each axis"
    )
    return "\n".join(lines)


@command("seed calibrate")
def main(argv: list[str]) -> int:
    """Measure a capture and write the calibration."""
    parser = Parser(prog="seed calibrate", description="Calibrate range and pose of the bubbles' cameras.")
    parser.add_argument("capture", type=Path, help="npz with depth images; see docs/how_to/calibrate.md")
    parser.add_argument(
        "--out", type=Path, default=Path("calibration.yaml"), help="file to write; default: %(default)s"
    )
    parser.add_argument("--membrane", type=Path, help="YAML of the membrane's shape: rim_x, rim_y, height, apex")
    parser.add_argument("--hand", help="the launch's hand_file, or YAML of the hand alone")
    parser.add_argument("--radius", type=number(0.003, "m", 0.05), default=0.012, help="[m] of the grasped cylinder")
    options = parser.parse_args(argv)
    shape = load_file(options.membrane, MembraneShape) if options.membrane else MembraneShape()
    hand = read_hand(options.hand, alone=True)[0] if options.hand else Hand()
    calibration = calibrate(*read_capture(options.capture), shape, options.radius, hand)
    save(calibration, options.out)
    print(table(calibration, hand))
    print(f"written to {options.out}; set the estimator's parameter `calibration` to it")
    return 0
