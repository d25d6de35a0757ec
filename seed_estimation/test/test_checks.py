# SPDX-License-Identifier: Apache-2.0
"""Bad images, and images that are missing, give a reason."""

from collections.abc import Callable
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rendered import PERIOD, held

from seed_core.config import ConfigError
from seed_core.hand import Hand
from seed_estimation import Estimator, EstimatorError, EstimatorParameters, TactileImages
from seed_estimation.images.normalise import normalised
from seed_sim.tactile.parameters import TactileParameters
from seed_sim.tactile.renderer import TactileRenderer

Images = dict[str, TactileImages]
stamps = count(1.0, PERIOD)


@pytest.fixture(scope="module")
def grasp() -> tuple[Estimator, TactileRenderer]:
    return held(TactileParameters(), 16)


def spoilt(images: Images, finger: str, **fields: np.ndarray) -> Images:
    return {**images, finger: replace(images[finger], **fields)}


def _full(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda image: np.full_like(image, value)


@pytest.mark.parametrize("finger", ["left", "right"])
@pytest.mark.parametrize(
    ("field", "change", "word"),
    [
        ("depth", _full(np.nan), "depth"),
        ("depth", _full(0.0), "depth"),
        ("depth", _full(-0.1), "depth"),
        ("depth", lambda d: d[:100, :50], "shape"),
        ("ir", lambda d: d[:100, :50], "shape"),
        ("ir", _full(65535.0), "saturated"),
        ("ir", _full(0.0), "black"),
        ("ir", _full(500.0), "constant"),
        ("ir", lambda d: 500.0 + 0.3 * np.random.default_rng(1).standard_normal(d.shape), "constant"),
        ("ir", lambda d: np.dstack((d, d, d)), "make it grey"),
        ("depth", lambda d: d.tolist(), "no array of numbers"),
        ("ir", lambda d: d > 0.0, "no array of numbers"),
        ("ir", _full(np.nan), "finite"),
        ("ir", _full(-5.0), "black"),
    ],
)
def test_a_bad_image_gives_a_reason(grasp: tuple[Estimator, TactileRenderer], finger: str, field: str,
                                    change: Callable[[np.ndarray], np.ndarray], word: str) -> None:  # fmt: skip
    estimator, bubbles = grasp
    images = bubbles.render(np.eye(4), 0.5)
    estimate = estimator.update(spoilt(images, finger, **{field: change(getattr(images[finger], field))}), 0.5)
    assert not estimate.valid
    assert word in estimate.reason
    assert finger in estimate.reason
    assert np.isfinite(estimate.X_CT).all()
    assert np.isfinite(estimate.covariance).all()
    assert estimator.patches == {}  # contact that was seen before is not what is there now


def test_a_silent_camera_and_time_running_backwards_give_a_reason() -> None:
    estimator, bubbles = held(TactileParameters(), 17)
    images = bubbles.render(np.eye(4), 0.1)
    assert "right" in estimator.update({"left": images["left"]}, 0.1).reason
    assert estimator.update(images, 0.1).valid
    assert "order" in estimator.update(images, 0.05).reason
    assert "not a time" in estimator.update(images, float("nan")).reason
    skewed = {**images, "right": replace(images["right"], stamp=0.9)}
    assert "apart" in estimator.update(skewed, 0.2).reason


def test_what_is_missing_is_named() -> None:
    bubbles = TactileRenderer(TactileParameters(), Hand(), 20)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    still, again = bubbles.no_contact(0.0), bubbles.no_contact(0.1)
    assert "no reference" in estimator.update(still, 0.1).reason
    with pytest.raises(EstimatorError, match="no reference"):
        estimator.initialize_grasp([still])
    estimator.capture_reference([still, again])
    assert "no grasp" in estimator.update(still, 0.2).reason
    with pytest.raises(EstimatorError, match="touches nothing"):
        estimator.initialize_grasp([still, again])
    with pytest.raises(EstimatorError, match="no usable"):
        estimator.capture_reference([])


def test_images_of_another_resolution_need_another_reference_and_another_method_another_grasp() -> None:
    estimator, bubbles = held(TactileParameters(), 17)
    p, images = estimator.parameters, bubbles.render(np.eye(4), 0.1)
    estimator.reconfigure(replace(p, method="published"))
    assert "no grasp" in estimator.update(images, 0.1).reason
    estimator.reconfigure(replace(p, decimate=p.decimate + 1))
    assert "no reference" in estimator.update(images, 0.1).reason
    with pytest.raises(EstimatorError, match="no reference"):
        estimator.initialize_grasp([images])


def test_a_single_image_is_no_reference_and_no_grasp() -> None:
    """How images differ tells noise, which is neither the fixed pattern nor the tool's shape; two do."""
    bubbles = TactileRenderer(TactileParameters(), Hand(), 20)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    free = [bubbles.no_contact(i * PERIOD) for i in range(2)]
    grasped = [bubbles.render(np.eye(4), 1.0 + i * PERIOD) for i in range(2)]
    with pytest.raises(EstimatorError, match="reference: 1 usable image of the left finger; at least 2"):
        estimator.capture_reference(free[:1])
    black = spoilt(free[1], "right", ir=np.zeros_like(free[1]["right"].ir))
    with pytest.raises(EstimatorError, match="reference: 1 usable image of the right finger; at least 2"):
        estimator.capture_reference([free[0], black])
    estimator.capture_reference(free)
    with pytest.raises(EstimatorError, match="grasp: 1 usable image of the left finger; at least 2"):
        estimator.initialize_grasp(grasped[:1])
    estimator.initialize_grasp(grasped)
    assert estimator.update(bubbles.render(np.eye(4), 1.1), 1.1).valid


def test_a_reference_of_one_depth_is_no_bubble_and_one_with_the_tool_in_it_is_named_when_nothing_touches() -> None:
    bubbles = TactileRenderer(TactileParameters(), Hand(), 20)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    noise = np.random.default_rng(1).normal(0.0, 2e-4, bubbles.no_contact(0.0)["left"].depth.shape)
    flat = [spoilt(bubbles.no_contact(i * PERIOD), "left", depth=(0.09 + noise).astype(np.float32)) for i in range(8)]
    with pytest.raises(EstimatorError, match=r"left bubble: the reference image reads 0\.0900 m"):
        estimator.capture_reference(flat)
    grasped = [bubbles.render(np.eye(4), i * PERIOD) for i in range(8)]
    estimator.capture_reference(grasped)
    with pytest.raises(EstimatorError, match="the reference was taken with the tool in it"):
        estimator.initialize_grasp(grasped)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_image_whatsoever_raises(grasp: tuple[Estimator, TactileRenderer], data: st.DataObject) -> None:
    """Patches of NaN, zeros, infinities or noise anywhere: an estimate comes back, finite, and valid ones are near."""
    estimator, bubbles = grasp
    images = bubbles.render(np.eye(4), 1.0)
    for finger in images:
        for field in ("depth", "ir"):
            image = getattr(images[finger], field).copy()
            v, u = data.draw(st.integers(0, 170)), data.draw(st.integers(0, 223))
            h, w = data.draw(st.integers(0, 171)), data.draw(st.integers(0, 224))
            image[v : v + h, u : u + w] = data.draw(st.sampled_from([np.nan, 0.0, -1.0, np.inf, -np.inf, 1e9, 0.08]))
            images = spoilt(images, finger, **{field: image})
    stamp = next(stamps)
    estimate = estimator.update({f: replace(i, stamp=stamp) for f, i in images.items()}, stamp)
    assert np.isfinite(estimate.X_CT).all()
    assert np.isfinite(estimate.covariance).all()
    if not estimate.valid:
        assert estimate.reason
    else:
        assert np.linalg.norm(estimate.X_CT[:3, 3]) < 5e-3


@pytest.mark.parametrize(("per_metre", "named"), [(1e3, "millimetres"), (1e4, "tenths of a millimetre")])
def test_depth_that_is_not_in_metres_is_recognised(
    grasp: tuple[Estimator, TactileRenderer], per_metre: float, named: str
) -> None:
    estimator, bubbles = grasp
    now = next(stamps)
    images = bubbles.render(np.eye(4), now)
    wrong = {f: replace(i, depth=np.nan_to_num(i.depth * per_metre).astype(np.uint16)) for f, i in images.items()}
    reason = estimator.update(wrong, now).reason
    assert f"look like {named}: divide depth by {per_metre:g}" in reason
    far = {f: replace(i, depth=7e5 * i.depth) for f, i in images.items()}
    assert "look like" not in estimator.update(far, now).reason


@pytest.mark.parametrize(("name", "value"), [("method", "nonsense"), ("near", -1.0), ("decimate", 0)])
def test_parameters_out_of_bounds_are_refused_wherever_they_come_from(
    grasp: tuple[Estimator, TactileRenderer], name: str, value: object
) -> None:
    estimator, bubbles = grasp
    wrong = replace(EstimatorParameters(), **{name: value})
    with pytest.raises(ConfigError, match=name):
        Estimator(wrong, Hand(), bubbles.cameras)
    with pytest.raises(ConfigError, match=name):
        estimator.reconfigure(wrong)


def test_arrays_that_are_no_tactile_images_are_refused_with_what_to_give(
    grasp: tuple[Estimator, TactileRenderer],
) -> None:
    estimator, bubbles = grasp
    good = bubbles.render(np.eye(4), next(stamps))
    tuples = {f: (i.depth, i.ir) for f, i in good.items()}
    for wrong, word in ((tuples, "left: its images are a tuple"), (list(good.values()), "one time are a list")):
        reason = estimator.update(wrong, next(stamps)).reason  # type: ignore[arg-type]
        assert word in reason
        assert "TactileImages(depth, brightness, stamp)" in reason
    for frames in ([tuples], good):  # a frame in place of frames is a mapping of names
        with pytest.raises(EstimatorError, match=r"give .*TactileImages\(depth, brightness, stamp\)"):
            estimator.capture_reference(frames)  # type: ignore[arg-type]


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_a_reduced_image_shows_infrared_and_depth_of_the_same_place(n: int) -> None:
    """With an even n infrared was that of half a pixel beside."""
    ramp = np.tile(np.arange(64, dtype=np.float32), (48, 1))
    images = TactileImages(ramp, ramp, 0.0)
    small = images.reduced(n, np.zeros(ramp[::n, ::n].shape, np.float32))
    assert_allclose(small.ir[3:-3, 3:-3], small.depth[3:-3, 3:-3], atol=1e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_an_infrared_pixel_without_a_number_spoils_no_other(value: float) -> None:
    ir = np.random.default_rng(0).uniform(500.0, 900.0, (48, 64)).astype(np.float32)
    clean = normalised(ir)
    ir[21, 21] = value
    found = normalised(ir)
    assert np.isfinite(found).all()
    assert_allclose(found[:, 40:], clean[:, 40:], atol=1e-3)


@pytest.mark.parametrize(("name", "said"), [("depth", "its depth image is the one before"), ("ir", "its infrared")])
def test_an_image_that_a_camera_sends_again_is_told_from_a_tool_that_stands_still(name: str, said: str) -> None:
    """One finger's image that stood still while the tool went on put the pose off by 1 mm, and it was valid."""
    estimator, bubbles = held(TactileParameters(), 17)
    last = bubbles.render(np.eye(4), PERIOD)
    assert estimator.update(last, PERIOD).valid
    stuck = spoilt(bubbles.render(np.eye(4), 2 * PERIOD), "right", **{name: getattr(last["right"], name)})
    estimate = estimator.update(stuck, 2 * PERIOD)
    assert not estimate.valid
    assert f"right: {said}" in estimate.reason
    assert estimator.update(bubbles.render(np.eye(4), 3 * PERIOD), 3 * PERIOD).valid


def test_images_without_noise_may_be_alike() -> None:
    bubbles = TactileRenderer(TactileParameters(), Hand(), 17)
    touched = bubbles.render(np.eye(4), -1.0)
    estimator = Estimator(EstimatorParameters(), Hand(), bubbles.cameras)
    estimator.capture_reference([bubbles.no_contact(-2.0 + i * PERIOD) for i in range(4)])
    estimator.initialize_grasp([touched, touched])
    for stamp in (-0.9, -0.8):
        assert estimator.update({f: replace(i, stamp=stamp) for f, i in touched.items()}, stamp).valid
