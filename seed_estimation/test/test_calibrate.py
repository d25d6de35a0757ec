# SPDX-License-Identifier: Apache-2.0
"""Calibration gives back the range errors and camera poses that the images were made with."""

from pathlib import Path

import numpy as np
import pytest

from seed_core.config import ConfigError, load_text
from seed_core.errors import SeedError
from seed_core.hand import Frame, Hand
from seed_core.spatial import inverse_pose, make_pose, so3_exp, so3_log
from seed_estimation.calibration import calibrate as cal
from seed_estimation.calibration import file
from seed_estimation.calibration.cylinder import GAP, TURN, Line, extrinsics
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer
from seed_sim.world.procedures.captures import captures


@pytest.fixture(scope="module")
def bubbles() -> TactileRenderer:
    return TactileRenderer(TactileParameters(range_offset=1.0), Hand(), 7)


@pytest.fixture(scope="module")
def shown(bubbles: TactileRenderer) -> dict:
    return captures(bubbles, frames=20, per_pose=4)


def test_the_smooth_range_error_is_found(bubbles: TactileRenderer, shown: dict) -> None:
    found = cal.calibrate(**shown, hand=Hand())
    assert set(found.fingers) == {"left", "right"}
    for finger, one in found.fingers.items():
        truth = -bubbles.fingers[finger].noise.offset
        error = (one.offset_map() - truth)[25:155, 30:180]
        assert np.abs(error).mean() < 0.15e-3  # the error itself is 3 to 17 mm


def test_a_camera_that_sits_askew_is_found(shown: dict) -> None:
    """The drawing is wrong by 1 degree and 1.2 mm in roll, yaw, x and y, equal and opposite on both sides."""
    wrong = make_pose(so3_exp(np.deg2rad((1.0, 0.0, 1.0))), (0.0012, 0.0012, 0.0))
    truth = Hand()
    X_CL, X_CR = wrong @ truth.X_CL, inverse_pose(wrong) @ truth.X_CR
    drawing = Hand(C_L=file.frame_of(X_CL), C_R=file.frame_of(X_CR))
    found = cal.calibrate(**shown, hand=drawing).hand(drawing)
    relative = inverse_pose(found.X_CL) @ found.X_CR @ inverse_pose(inverse_pose(truth.X_CL) @ truth.X_CR)
    assert np.rad2deg(np.linalg.norm(so3_log(relative[:3, :3]))) < 0.45  # it was 2.8
    y = (found.X_CL[:3, 3] - found.X_CR[:3, 3])[1] - (truth.X_CL[:3, 3] - truth.X_CR[:3, 3])[1]
    assert abs(y) < 0.5e-3  # it was 2.4 mm


def test_the_table_tells_what_each_camera_was_off_by(shown: dict) -> None:
    """A drawing that is wrong by 1 degree and 2 mm on either side comes out with both numbers."""
    wrong = make_pose(so3_exp(np.deg2rad((1.0, 0.0, 0.0))), (0.002, 0.0, 0.0))
    truth = Hand()
    drawing = Hand(C_L=file.frame_of(wrong @ truth.X_CL), C_R=file.frame_of(inverse_pose(wrong) @ truth.X_CR))
    head, left, right, known = cal.table(cal.calibrate(**shown, hand=drawing), drawing).splitlines()
    numbers = {row[:5].strip(): [float(v) for v in row.replace(")", " ").split()[-6:]] for row in (left, right)}
    assert head.split()[0] == "finger"
    np.testing.assert_allclose([numbers["left"][0], numbers["right"][0]], (-2.0, 2.0), atol=0.5)  # [mm] along x
    np.testing.assert_allclose([numbers["left"][3], numbers["right"][3]], (-1.0, 1.0), atol=0.3)  # [deg] about x
    assert "known to 0.15 mm and 0.07 degrees" in known
    alone = cal.table(cal.calibrate(**{**shown, "grasped": {}}, hand=truth), truth)
    assert "camera poses are as drawn" in alone
    assert "0.00   0.00   0.00     0.00   0.00   0.00" in alone


def test_a_calibration_survives_its_file(tmp_path: Path, shown: dict) -> None:
    found = cal.calibrate(**{**shown, "grasped": {}}, hand=Hand())
    file.save(found, tmp_path / "c.yaml")
    again = file.load(tmp_path / "c.yaml")
    assert set(again.fingers) == set(found.fingers) == {"left", "right"}
    for finger in found.fingers:
        np.testing.assert_array_equal(again.fingers[finger].offset_map(), found.fingers[finger].offset_map())
        np.testing.assert_allclose(again.hand(Hand()).X_CL, found.hand(Hand()).X_CL, atol=1e-12)


MINE = Hand(C_L=Frame((0.0, 0.09, 0.0), (90.0, 0.0, 0.0)), C_R=Frame((0.0, -0.09, 0.0), (-90.0, 0.0, 0.0)))


def test_a_calibration_of_the_range_alone_leaves_the_cameras_of_any_hand_where_they_are(shown: dict) -> None:
    assert cal.calibrate(**{**shown, "grasped": {}}, hand=Hand()).hand(MINE) == MINE


def test_camera_poses_that_were_found_from_another_hand_s_drawing_are_refused(tmp_path: Path, shown: dict) -> None:
    file.save(cal.calibrate(**shown, hand=Hand()), tmp_path / "c.yaml")
    found = file.load(tmp_path / "c.yaml")
    assert 0.0 < abs(found.hand(Hand()).C_L.position[1] - 0.105) < 0.005
    with pytest.raises(ConfigError, match=r"left camera is drawn at \(0.0, 0.105, 0.0\) m.* at \(0.0, 0.09, 0.0\) m"):
        found.hand(MINE)


def test_a_calibration_of_an_earlier_release_counts_as_it_did() -> None:
    text = "fingers: {left: {pose: {position: [0.0, 0.1, 0.0], rpy_deg: [90.0, 0.0, 0.0]}, width: 224, height: 171}}"
    assert load_text(text, file.Calibration).hand(MINE).C_L.position == (0.0, 0.1, 0.0)


def test_a_finger_of_another_name_is_refused() -> None:
    with pytest.raises(ConfigError, match="fingers has the key 'Left'; it may have: left, right"):
        load_text("fingers: {Left: {width: 224, height: 171}}", file.Calibration)


def test_poses_of_the_cylinder_that_lie_alike_are_refused(shown: dict) -> None:
    grasped = {finger: [images[0]] * 3 for finger, images in shown["grasped"].items()}
    with pytest.raises(
        SeedError, match=r"lies alike in all poses, within 0.0 degrees \(at least 8\).* tilt it by 10 to"
    ):
        cal.calibrate(**{**shown, "grasped": grasped}, hand=Hand())


def test_the_fewer_tilts_there_are_the_less_is_stated_to_be_known(shown: dict) -> None:
    few = {finger: [images[i] for i in (0, 0, 1)] for finger, images in shown["grasped"].items()}  # 10 deg of roll
    one, five = (cal.calibrate(**{**shown, "grasped": g}, hand=Hand()) for g in (few, shown["grasped"]))
    assert one.mutual_rotation_std > 1.5 * five.mutual_rotation_std


@pytest.mark.parametrize("tilts", [(0, 5, -5), (0, 15, -15), (0, 8, 20)])
def test_what_is_stated_of_the_cameras_is_what_they_err_by(tilts: tuple[float, ...]) -> None:
    """Of 60 draws, axes off by a quarter of the noise that they are weighed with, drawings by 6 mrad and 1 mm."""
    rng, hand, errors, stated = np.random.default_rng(0), Hand(), [], []
    for _ in range(60):
        half = 0.5 * rng.normal(size=6) * np.repeat([6e-3, 1e-3], 3)
        X = [make_pose(so3_exp(s * half[:3]), s * half[3:]) @ X for s, X in ((1, hand.X_CL), (-1, hand.X_CR))]
        lines: tuple[list[Line], list[Line]] = ([], [])
        for deg in tilts:
            for X_CX, seen in zip(X, lines, strict=True):
                turn, shift = 0.25 * rng.normal(size=(2, 3)) * np.array([TURN, [GAP] * 3]) / np.sqrt(2.0)
                d = so3_exp(turn) @ so3_exp(np.array([0.0, np.deg2rad(deg), 0.0])) @ np.array([0.0, 0.0, 1.0])
                seen.append(Line(shift, d).moved(inverse_pose(X_CX)))
        A, B, std = extrinsics(*lines, hand.X_CL, hand.X_CR)
        E = A @ inverse_pose(X[0]) @ inverse_pose(B @ inverse_pose(X[1]))
        errors.append(np.concatenate([so3_log(E[:3, :3]), E[:3, 3]]))
        stated.append(std)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(stated), axis=0))
    assert ratio.max() < 1.3
    assert ratio.min() > 0.7


def test_poses_that_only_one_camera_has_seen_are_refused(shown: dict) -> None:
    grasped = {**shown["grasped"], "right": shown["grasped"]["right"][:-1]}
    with pytest.raises(SeedError, match="poses of the cylinder in the capture: left 5, right 4; each must be"):
        cal.calibrate(**{**shown, "grasped": grasped}, hand=Hand())


def test_the_command_says_what_is_wrong_with_a_capture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.npz").write_bytes(b"nothing")
    assert cal.main([str(tmp_path / "x.npz")]) == 2
    assert "x.npz" in capsys.readouterr().err


def test_a_membrane_elsewhere_is_refused(shown: dict) -> None:
    with pytest.raises(SeedError, match="shape and distance"):
        cal.calibrate(**{**shown, "shape": cal.MembraneShape(apex=0.2)}, hand=Hand())


def capture(path: Path, shown: dict, **changed: np.ndarray) -> str:
    """A file of the captures without the cylinder, with arrays changed; its name."""
    arrays = {f"{f}_{name}": getattr(camera, name) for f, camera in shown["cameras"].items() for name in ("K", "D")}
    arrays |= {f"{f}_no_contact": np.stack(images) for f, images in shown["no_contact"].items()}
    np.savez(path, **{**arrays, **changed})
    return str(path)


@pytest.mark.parametrize("cut", [np.s_[:, :-3], np.s_[0]])
def test_images_of_the_cylinder_in_another_size_are_refused(
    tmp_path: Path, shown: dict, cut: object, capsys: pytest.CaptureFixture[str]
) -> None:
    grasped = np.stack(shown["grasped"]["left"])
    shape = grasped[cut][0].shape
    name = capture(tmp_path / "x.npz", shown, left_grasped=grasped[cut])
    assert cal.main([name, "--out", str(tmp_path / "c.yaml")]) == 2
    assert f"x.npz: not a capture for calibration: images in left_grasped have shape {shape}, free ones (171, 224)" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("out", ["", ".", "/", "folder"])
def test_a_folder_is_no_file_to_write_a_calibration_to(
    out: str, tmp_path: Path, shown: dict, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    assert cal.main([capture(tmp_path / "x.npz", shown), "--out", out]) == 2
    assert "is a folder or a device: name a file" in capsys.readouterr().err
    assert sorted(f.name for f in tmp_path.iterdir()) == ["folder", "x.npz"]
