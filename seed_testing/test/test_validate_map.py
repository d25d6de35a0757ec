# SPDX-License-Identifier: Apache-2.0
"""The comparison of wrench models: what a watcher tells of nodes, the motion, and scores that are kept."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from seed_core.errors import SeedError
from seed_core.spatial import Wrench, make_pose, so3_exp, so3_log
from seed_sim.membrane import BubbleState, GraspState
from seed_sysid.membrane.terms import MODELS
from seed_testing.validation.maps import band, image_run, score
from seed_testing.validation.maps.membrane_run import NOISE_SHIFT, NOISE_TURN, Watcher, combined_motion, poses
from seed_testing.validation.maps.score import OF_ELEMENTS, OF_POSE, score_membranes, table

MOVED = make_pose(so3_exp([0.05, -0.08, 0.1]), [0.001, -0.002, 0.003])


def grasp(X: np.ndarray) -> GraspState:
    """Two flat membranes of nodes that have moved by X; the tool touches them in the middle."""
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(-0.02, 0.02, 9), np.linspace(-0.025, 0.025, 11)))
    bubbles = {}
    for finger, side in (("left", 1.0), ("right", -1.0)):
        nodes = np.stack([u, np.full(len(u), 0.012 * side), v], 1) @ X[:3, :3].T + X[:3, 3]
        touching = np.hypot(u, v) < 0.012
        bubbles[finger] = BubbleState(
            nodes=nodes,
            triangles=np.zeros((0, 3), int),
            material=np.stack([u, v], 1),
            touching=touching,
            patch=nodes[touching],
            touched=3e-4,
            slid=0.0,
            pressure=3500.0,
            volume=2e-4,
            wrench=Wrench.zero(),
        )
    return GraspState(np.eye(4), bubbles, Wrench.zero(), np.zeros((6, 6)), 1, True)


def test_without_noise_a_rigid_motion_is_told_exactly() -> None:
    for m in Watcher(grasp(np.eye(4)), 0.0, np.random.default_rng(0)).motions(grasp(MOVED), 101325.0):
        assert_allclose(m.X_CM, MOVED, atol=1e-12)
        assert_allclose(m.deformation, 0.0, atol=1e-12)
        assert_allclose(m.pressure, 1048.25)


def test_errors_are_as_large_as_the_covariance_says() -> None:
    watcher = Watcher(grasp(np.eye(4)), 1.0, np.random.default_rng(0))
    told = [watcher.motions(grasp(MOVED), 0.0)[0] for _ in range(1500)]
    turns = np.array([so3_log(m.X_CM[:3, :3] @ MOVED[:3, :3].T) for m in told])
    errors = np.hstack([turns, [m.X_CM[:3, 3] - MOVED[:3, 3] for m in told]])
    expected = np.sqrt(np.diag(told[0].covariance))
    assert_allclose(errors.std(axis=0), expected, rtol=0.1)
    assert_allclose(expected[:3], NOISE_TURN, rtol=1e-6)
    assert expected[3] > NOISE_SHIFT[0]  # a turn about the patch shifts the origin


def test_what_the_estimator_tells_of_a_band_is_near_to_what_its_nodes_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(band, "DURATION", 1.0)
    result = band.scores([5610], 1)
    assert result["scored"] == 1
    rms = np.array(result["rms"])
    assert (rms > 0.0).all()
    assert (rms[:3] < 0.3).all()  # degrees
    assert (rms[3:] < 0.1).all()  # mm
    assert (np.array(result["quick"]) < rms).all()
    assert f"{rms[0]:.3f}" in band.table(result)


def test_a_membrane_that_cannot_be_measured_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise SeedError("it is too small")

    monkeypatch.setattr(band, "renderer_of", refuse)
    assert "membrane 3 failed: it is too small" in band.table(band.scores([3], 1))


def test_the_motion_starts_at_the_grasp_and_has_its_size() -> None:
    motion = poses(combined_motion(np.random.default_rng(1), 400), 1.5)
    assert_allclose(motion[0], np.eye(4), atol=1e-12)
    assert_allclose(np.std([X[:3, 3] for X in motion], axis=0), 3e-3, rtol=1e-6)
    assert_allclose(np.rad2deg(np.std([so3_log(X[:3, :3]) for X in motion], axis=0)), 6.0, rtol=0.1)


def test_an_estimator_in_the_loop_tells_the_wrench_by_what_it_has_identified_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A coarse membrane, few poses and a small motion: whether the chain holds, not how exact it is."""
    monkeypatch.setattr(image_run, "SPACING", 0.0065)
    plain = image_run.load("default")
    few = replace(plain.procedure.excitation, poses=40)
    plain = replace(plain, procedure=replace(plain.procedure, excitation=few, widths=plain.procedure.widths[1:2]))
    monkeypatch.setattr(image_run, "load", lambda _: plain)
    monkeypatch.setattr(image_run, "size_of", lambda *_: 0.4)
    monkeypatch.setattr(score, "SHARES", (0.2,))
    result = score_membranes([5902], None, 1, None, frames=20)
    assert result["scored"] == 1, result["runs"]
    (motion,) = result["runs"][0]["motions"]
    assert motion["told"] > 0.9
    shares = motion["shares"]
    assert not any(name in shares for name in OF_ELEMENTS)
    assert max(shares["smooth"][3:]) < 0.25
    assert shares["smooth"][1] < 0.5 * shares[OF_POSE][1]  # pitch, in which a tool slides
    assert "as the estimator sees them" in table(result)


def test_kept_scores_are_not_made_again(tmp_path: Path) -> None:
    def one(share: float) -> list[dict[str, object]]:
        shares = {m: [share] * 6 for m in (OF_POSE, *MODELS)}
        told = {"nees": 5.0, "nees_in_C": 5.0, "doubted": 0.0}
        return [{"asked": s, "size": 1.0, "sliding": s, "rms": [1.0] * 6, "shares": shares, **told}
                for s in (0.4, 0.65)]  # fmt: skip

    for seed, share in ((5, 0.01), (6, 0.02), (7, 0.06)):
        (tmp_path / f"membrane-{seed}-0-100.json").write_text(json.dumps({"seed": seed, "motions": one(share)}))
    (tmp_path / "membrane-8-0-100.json").write_text(json.dumps({"seed": 8, "failed": "it burst"}))
    result = score_membranes(range(5, 9), 0.0, 1, tmp_path)
    assert (result["membranes"], result["scored"]) == (4, 3)
    assert result["summary"][0]["shares"]["smooth"]["median"] == [0.02] * 6
    text = table(result)
    assert "2.0   5.2   6.0" in text
    assert "membrane 8 failed: it burst" in text
