# SPDX-License-Identifier: Apache-2.0
"""Images that are turned, or another finger's, are told by their dots."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rendered import held

from seed_core.errors import SeedError
from seed_estimation import EstimatorError
from seed_estimation.images import identity
from seed_sim.tactile.parameters import TactileParameters


def test_a_finger_that_comes_later_is_remembered_beside_the_one_that_is_known(tmp_path: Path) -> None:
    """The first session has the left bubble only, the second both, the third both in each other's place."""
    file, rng = tmp_path / "bubbles.npz", np.random.default_rng(3)
    dots = [identity.pattern((1000 + 500 * rng.random((171, 224))).astype(np.float32)) for _ in range(2)]
    left, right = (identity.Known(pattern, "camera", np.eye(3)) for pattern in dots)

    def session(**seen: identity.Known) -> tuple[str, set[str]]:
        bubbles = identity.KnownBubbles(str(file), dict.fromkeys(seen, "camera"))
        bubbles.judge(seen)
        return bubbles.status, set(identity.load(file))

    session(left=left)
    for strange in ({"left": right, "right": left}, {"right": left}):
        assert session(**strange)[1] == {"left"}
    assert session(left=left, right=right) == ("unverified", {"left", "right"})
    assert session(left=left, right=right)[0] == "verified by dots"
    np.testing.assert_array_equal(identity.load(file)["right"].pattern, right.pattern)


def test_the_file_is_the_old_one_until_the_new_one_is_whole(tmp_path: Path) -> None:
    file, before = tmp_path / "bubbles.npz", tmp_path / "before.npz"
    left = identity.Known(np.ones((17, 22), np.float32), "camera", np.eye(3))
    identity.save(file, {"left": left})
    before.hardlink_to(file)
    identity.save(file, {"right": left})
    assert (set(identity.load(before)), set(identity.load(file))) == ({"left"}, {"right"})
    assert len(list(tmp_path.iterdir())) == 2


def test_a_damaged_file_is_refused_with_the_remedy(tmp_path: Path) -> None:
    file = tmp_path / "bubbles.npz"
    identity.save(file, {"left": identity.Known(np.ones((17, 22), np.float32), "camera", np.eye(3))})
    for share in (2, 1000000):
        file.write_bytes(file.read_bytes()[: file.stat().st_size // share])
        with pytest.raises(SeedError, match=r"identity_file is damaged, .*remove it, and the next reference writes"):
            identity.KnownBubbles(str(file), {})


def test_images_turned_or_swapped_are_named() -> None:
    estimator, bubbles = held(TactileParameters(), 18)
    images = bubbles.render(np.eye(4), 0.1)
    turned = {f: replace(i, ir=np.ascontiguousarray(i.ir[::-1, ::-1])) for f, i in images.items()}
    assert "180" in estimator.update(turned, 0.1).reason
    swapped = {"left": images["right"], "right": images["left"]}
    assert "swapped" in estimator.update(swapped, 0.2).reason


def test_a_reference_of_the_other_finger_is_refused() -> None:
    estimator, bubbles = held(TactileParameters(), 19)
    images = bubbles.no_contact(0.1)
    with pytest.raises(EstimatorError, match="swapped"):
        estimator.capture_reference([{"left": images["right"], "right": images["left"]}])


def test_a_grasp_of_fingers_that_were_swapped_after_the_reference_is_refused() -> None:
    estimator, bubbles = held(TactileParameters(), 20)
    swapped = {"left": "right", "right": "left"}
    images = [bubbles.render(np.eye(4), 1.0 + 0.1 * i) for i in range(3)]
    with pytest.raises(EstimatorError, match="swapped"):
        estimator.initialize_grasp([{f: i[other] for f, other in swapped.items()} for i in images])
    estimator.initialize_grasp(images)


def test_bubbles_that_this_session_has_written_are_not_written_anew(tmp_path: Path) -> None:
    file, rng = tmp_path / "bubbles.npz", np.random.default_rng(4)
    dots = [identity.pattern((1000 + 500 * rng.random((171, 224))).astype(np.float32)) for _ in range(2)]
    left, right = (identity.Known(pattern, "camera", np.eye(3)) for pattern in dots)
    bubbles = identity.KnownBubbles(str(file), {"left": "camera", "right": "camera"})
    bubbles.judge({"left": left, "right": right})
    bubbles.judge({"left": right, "right": left})
    assert bubbles.status == "unverified"
    np.testing.assert_array_equal(identity.load(file)["left"].pattern, left.pattern)
